"""Which keyframes see the same place again: candidates, and their verification."""
