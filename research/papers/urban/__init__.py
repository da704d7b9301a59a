"""Barbosa et al.: tracking in a street in an open and in a closed loop, Figures 3 to 6."""

from research.papers.urban.claims import check_claims
from research.papers.urban.files import FILES, write
from research.papers.urban.study import TRACKERS, play
from research.papers.urban.table import markdown

__all__ = ["FILES", "TRACKERS", "check_claims", "markdown", "play", "write"]
