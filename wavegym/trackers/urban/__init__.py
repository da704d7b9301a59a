"""Tracker of an unknown number of targets on an urban map."""
