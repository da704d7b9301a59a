"""Old names of ``wavegym.core.array_checks``, for the modules that still import them from here."""

from wavegym.core.array_checks import check_elements as every
from wavegym.core.array_checks import check_last_axes as shaped
from wavegym.core.array_checks import check_shape as require_shape

__all__ = ["every", "require_shape", "shaped"]
