"""The benchmark of kinematics compares two sides that agree, for few rows and for many."""

from benchmarks.motion.kinematics import measure


def test_both_sides_agree_and_are_measured_for_every_number_of_rows():
    rows = measure(1, (1, 30))
    assert [(r.what, r.rows) for r in rows] == [(what, n) for n in (1, 30) for what in ("jacobian", "inverse")]
    assert all(r.batched > 0.0 and r.one_by_one > 0.0 for r in rows)
