"""O'Rourke and Swindlehurst: platforms with a radar and a camera, Figures 2 to 4."""

from research.papers.rf_eo.claims import check_claims
from research.papers.rf_eo.files import FILES, write
from research.papers.rf_eo.study import TRACKERS, play
from research.papers.rf_eo.table import markdown

__all__ = ["FILES", "TRACKERS", "check_claims", "markdown", "play", "write"]
