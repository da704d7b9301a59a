"""Kershaw and Evans: one target on the line of sight, closed forms and their choices."""

from research.papers.kershaw_evans.claims import check_claims
from research.papers.kershaw_evans.files import FILES, write
from research.papers.kershaw_evans.study import play
from research.papers.kershaw_evans.table import markdown

TRACKERS = ()

__all__ = ["FILES", "TRACKERS", "check_claims", "markdown", "play", "write"]
