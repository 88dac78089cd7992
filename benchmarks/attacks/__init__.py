"""Hostile input for vnav, class by class; benchmarks/attack.py runs it."""
