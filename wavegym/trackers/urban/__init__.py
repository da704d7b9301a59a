"""A tracker of unknown targets on the streets of an urban map."""
