"""Pictures and pages of maps, answers and runs."""
