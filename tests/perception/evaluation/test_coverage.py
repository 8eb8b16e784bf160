"""Spreads against errors: how often errors lie within what is claimed, and what counts as refused."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.looking.conditions import under_condition
from perception.errors import FrameError
from perception.estimates import ObjectEstimate
from perception.evaluation.coverage import claimed, coverage, coverage_table, share_with_interval
from perception.ground_truth import TrueObject
from tests.support.scenes.perception_scenes import RED, cube, render

SIZES, SPREAD = np.array([0.10, 0.06, 0.04]), 0.002


def truth(share: float = 1.0) -> TrueObject:
    pose = np.eye(4)
    pose[:3, 3] = (0.5, 0.1, 0.02)
    return TrueObject("box", pose, SIZES, "box", visible_share=share)


def estimate(rng: np.random.Generator | None = None, claims: float = SPREAD) -> ObjectEstimate:
    """Off by errors of `SPREAD`, or by nothing; what it claims is another matter."""
    draw = (lambda n: rng.normal(0.0, SPREAD, n)) if rng is not None else np.zeros
    pose, turn = truth().world_T_object.copy(), float(draw(1)[0])
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[:3, 3] += draw(3)
    stds = np.full(3, claims)
    return ObjectEstimate("box", "box", pose, SIZES + draw(3), "box", stds, claims, 1.0, 0.0, extents_std=stds)


@pytest.mark.parametrize(("claims", "one", "two"), [(SPREAD, 0.68, 0.95), (SPREAD / 2, 0.38, 0.67)])
def test_spreads_that_are_true_cover_68_and_95_percent_and_those_half_as_large_do_not(claims, one, two):
    rng = np.random.default_rng(0)
    within = coverage([claimed(estimate(rng, claims), truth()) for _ in range(2000)])["within"]
    for quantity in ("x", "y", "z", "yaw", "width", "height"):
        assert within[quantity]["68"] == pytest.approx(one, abs=0.04)
        assert within[quantity]["95"] == pytest.approx(two, abs=0.04)
        low, high = within[quantity]["95_ci95"]
        assert low < within[quantity]["95"] < high


def test_what_is_doubted_or_not_seen_is_refused_and_counts_from_half_in_view():
    doubted = replace(estimate(), doubts=("nothing carries it",))
    figures = coverage(
        [
            claimed(estimate(), truth()),
            claimed(doubted, truth()),
            claimed(None, truth(), "not enough depth"),
            claimed(None, truth(share=0.4)),
        ]
    )
    assert (figures["n"], figures["offered"]) == (4, 1)
    assert figures["refused"]["share"] == pytest.approx(2 / 3, abs=1e-3)
    assert figures["by_kind"]["hidden in part"]["n"] == 1
    assert "0.67" in coverage_table(figures)


def test_a_few_of_a_few_is_a_wide_share():
    share, interval = share_with_interval([True] * 9 + [False])
    assert share == 0.9 and interval == pytest.approx((0.596, 0.982), abs=0.001)
    assert share_with_interval([]) == (None, None)


def test_conditions_lose_a_share_of_the_depth_or_scale_all_of_it():
    frame, rng = render([cube(RED, 0.5, 0.0)]), np.random.default_rng(0)
    assert under_condition(frame, "plain", rng) is frame
    lost = under_condition(frame, "dropout:0.3", rng)
    assert np.isnan(lost.depth).mean() == pytest.approx(0.3, abs=0.02)
    assert under_condition(frame, "scale:1.02", rng).depth == pytest.approx(1.02 * frame.depth, rel=1e-5)
    with pytest.raises(FrameError, match="there is no condition 'fog'; there are plain, dropout:SHARE"):
        under_condition(frame, "fog", rng)
