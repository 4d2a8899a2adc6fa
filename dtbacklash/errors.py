"""The errors that a user can cause: one line each, naming the key, the value and what is allowed."""


class UserError(ValueError):
    """A wrong choice by the user.

    Parameters
    ----------
    key : the dotted name of the setting as the user would write it, e.g. ``twin.delay_s``.
    value : what was given.
    allowed : what is allowed, as a short phrase.
    """

    def __init__(self, key: str, value: object, allowed: str) -> None:
        self.key, self.value, self.allowed = key, value, allowed
        super().__init__(key, value, allowed)

    def __str__(self) -> str:
        text = " ".join(str(self.value).split())
        if len(text) > 120:
            text = text[:117] + "..."
        return f"{self.key}={text}: {self.allowed}"


class Diverged(UserError):
    """The simulated loop left every plausible range: the chosen controller is unstable on this rig."""

    def __init__(self, key: str, value: object, t_s: float, what: str) -> None:
        self.t_s = t_s
        likely = "controller.k_theta_v_per_rad, sample_time_s, and internal_model=bare under a load or friction"
        allowed = f"the loop diverged at t = {t_s:.3f} s ({what}); look at {likely}"
        UserError.__init__(self, key, value, allowed)
        self.args = (key, value, t_s, what)  # so that it survives pickling between workers
