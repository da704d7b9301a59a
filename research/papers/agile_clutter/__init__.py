"""Sira, Papandreou-Suppappola, Morrell and Cochran: agile waveforms in clutter, Figures 2 and 3."""

from research.papers.agile_clutter.claims import check_claims
from research.papers.agile_clutter.files import FILES, write
from research.papers.agile_clutter.study import TRACKERS, play
from research.papers.agile_clutter.table import markdown

__all__ = ["FILES", "TRACKERS", "check_claims", "markdown", "play", "write"]
