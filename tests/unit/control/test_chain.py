"""What the controllers cannot be designed for is refused by its name."""

import pytest
from told import refused

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import beliefs_of, design_for


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("rig=emps", "controller=nimc_fixed"),
            "controller=nimc_fixed: needs a rig with a gear; emps has none: give controller=open_loop",
        ),
        (("rig=emps", "controller=imc"), "rig=emps: this controller needs a rig with a motor"),
        (("rig.parameters.k.value=0",), "rig.parameters.k.value=0.0: above 0 N/m: link_1 drives mass_2"),
    ],
)
def test_what_cannot_be_designed_for_is_named(words, said):
    config = compose(*words)
    with refused(start=said):
        design_for(config, beliefs_of(config).design)
