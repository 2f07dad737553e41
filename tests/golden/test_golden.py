"""Nothing changes an answer unawares."""

import numpy as np
import pytest

from tests.golden.answers import FILE, PRESETS, answers, machine


@pytest.mark.parametrize("preset", PRESETS)
def test_answers_are_those_on_record(preset: str) -> None:
    with np.load(FILE) as golden:
        same_machine = str(golden["machine"]) == machine()
        expected = {key: golden[key] for key in golden.files if key.startswith(f"{preset}/")}
    found = answers(preset)
    assert found.keys() == expected.keys()
    tolerance = 1e-6 if same_machine else 1e-3
    for key, values in expected.items():
        np.testing.assert_allclose(found[key], values, rtol=0, atol=tolerance, err_msg=key)
