"""What makes this repository's own figures, proofs and times; not in the wheel."""
