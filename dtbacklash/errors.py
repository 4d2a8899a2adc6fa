"""The errors that a user can cause: one line each, naming the key, the value and what is allowed."""


class UserError(ValueError):
    """A wrong choice by the user.

    Parameters
    ----------
    key : the dotted name of the setting as the user would write it, e.g. ``twin.delay_s``.
    value : what was given.
    allowed : what is allowed, as a short phrase.
    """

    #: of a command that it ends
    exit_code = 2
    #: what was done when nothing of it could be written; None where there is nothing
    result: object = None

    def __init__(self, key: str, value: object, allowed: str) -> None:
        self.key, self.value, self.allowed = key, value, allowed
        super().__init__(key, value, allowed)

    def __str__(self) -> str:
        text = " ".join(str(self.value).split())
        if len(text) > 120:
            text = text[:117] + "..."
        return f"{self.key}={text}: {self.allowed}"


class Failure(UserError):
    """What was asked was right, and the machine failed in the middle of the work: a full disk. Same arguments."""

    exit_code = 1


class Diverged(UserError):
    """The simulated loop left every plausible range: the chosen controller is unstable on this rig.

    ``cause`` says why and which setting helps, where that is known.
    """

    def __init__(self, key: str, value: object, t_s: float, what: str, cause: str = "") -> None:
        self.t_s = t_s
        cause = cause or "look at controller.k_theta_v_per_rad and sample_time_s"
        UserError.__init__(self, key, value, f"the loop diverged at t = {t_s:.3f} s ({what}). {cause}")
        self.args = (key, value, t_s, what, cause)  # so that it survives pickling between workers
