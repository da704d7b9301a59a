"""A reward that looks at the worst target."""


class WorstTarget:
    """Minus the greatest position error of all targets in m."""

    def begin(self, system, world):
        """The memory of these worlds: none."""
        return None

    def __call__(self, transition):
        """Rewards (env,) float64, and terms for info by name, each (env,)."""
        error = transition.system.state_info(transition.following)["position_error"]
        worst = error.reshape(len(error), -1).max(axis=1)
        return -worst, {"worst_error": worst}
