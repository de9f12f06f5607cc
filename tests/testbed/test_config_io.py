"""Messages on wrong values: the key as the file has it, and what is allowed there."""

import pytest
from proving_ground.experiments.studies.sweep.study import Study
from proving_ground.testbed.configuration.config_io import validated


@pytest.mark.parametrize(
    ("seeds", "beginning"),
    [
        ([], "seeds: "),
        ("x", "seeds: "),
        (-1, "seeds: "),
        ([1, 1.5], "seeds.1: "),
        ([-1], "seeds.0: "),
    ],
)
def test_a_key_of_several_forms_is_named_as_it_stands_in_the_file(seeds, beginning):
    content = {"description": "d", "scenario": "grass", "seeds": seeds}
    with pytest.raises(ValueError, match=beginning) as caught:
        validated(Study, content, ValueError)
    message = str(caught.value)
    assert message.startswith(beginning)
    assert "constrained" not in message
    assert "\n" not in message


def test_the_form_that_was_nearly_met_says_what_is_wrong():
    content = {"description": "d", "scenario": "grass", "seeds": []}
    with pytest.raises(ValueError, match="at least 1 item"):
        validated(Study, content, ValueError)
