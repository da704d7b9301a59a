"""Networks in torch, and their export to plain NumPy."""
