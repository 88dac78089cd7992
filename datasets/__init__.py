"""Catalogue of public sequences and evaluation suites."""
