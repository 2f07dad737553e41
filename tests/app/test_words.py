"""Sentences of the page."""

import torch

from steered_marigold.app.words import hole_facts, in_words_of_the_page, warnings
from steered_marigold.core.notices import Notice
from tests.app.test_views import completion_of, frame_of


def test_arguments_become_the_fields_of_the_page() -> None:
    text = "is `depth_scale`, metres per unit, right? `depth_grid=registered` helps; `x` not"
    assert in_words_of_the_page(text) == (
        "is “Depth scale”, metres per unit, right? “Lower resolution, same view” helps; x not"
    )
    assert in_words_of_the_page("/tmp/a/b.png: damaged", ("/tmp/a",)) == "b.png: damaged"


def test_warnings_cannot_carry_markup() -> None:
    said = warnings((Notice("kind", "<script>alert(1)</script> & more"),))
    assert "<script>" not in said
    assert "&lt;script&gt;" in said


def test_the_error_in_a_hole_is_that_of_its_measured_pixels() -> None:
    truth = frame_of()
    erased = torch.zeros(truth.size, dtype=torch.bool)
    erased[5:12, :] = True  # 5 rows were never measured, 2 were
    completion = completion_of(truth)
    off = torch.where(erased, completion.depth[0] + 0.25, completion.depth[0])
    said = hole_facts(type(completion)(**{**vars(completion), "depth": off[None]}), truth, erased)
    assert "<b>60</b> erased pixels" in said
    assert "<b>0.250 m</b>" in said
    assert "RMSE 0.250 m" in said
    assert "covers 0% of them" in said
    nothing = hole_facts(completion, truth, torch.zeros_like(erased))
    assert "Nothing had been measured" in nothing
