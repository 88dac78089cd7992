"""The stages of a map and of a question: load, compute, write, report."""
