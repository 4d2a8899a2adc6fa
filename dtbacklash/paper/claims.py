"""Every checkable statement of the paper, in its order."""

from dtbacklash.paper import backlash_claims, linear_claims, novelty_claims, twin_claims
from dtbacklash.paper.claim import Claim
from dtbacklash.paper.experiments import Experiments


def all_claims(experiments: Experiments) -> list[Claim]:
    """Check every claim."""
    groups = (
        linear_claims.design,
        linear_claims.disturbance,
        linear_claims.figure_4,
        linear_claims.figure_6,
        linear_claims.load,
        linear_claims.figure_7,
        backlash_claims.figure_8,
        backlash_claims.figure_10,
        backlash_claims.exact,
        twin_claims.estimator,
        twin_claims.optimizers,
        twin_claims.figure_13,
        novelty_claims.figure_14,
        novelty_claims.novelty_filter,
        novelty_claims.noise,
        novelty_claims.tracked_frequency,
    )
    return [claim for group in groups for claim in group(experiments)]
