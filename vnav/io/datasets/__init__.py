"""Public sequences and suites of them."""
