"""The closed loops, one folder each. ``wavegym.core.system`` states what a system must offer."""
