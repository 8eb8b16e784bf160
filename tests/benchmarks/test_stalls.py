"""What `replan bench stalls` makes of an episode's record and events."""

import pytest

from benchmarks.robot_side.stalls import as_json, as_text, judge
from replan.rc.records import EpisodeRecord

JOB = {"task": "cubes-color", "seed": 201, "variant": {}}
GONE = "the robot process at tcp/127.0.0.1:1 has ended, or the link to it was lost"


def record(**fields) -> EpisodeRecord:
    return EpisodeRecord(setup={}, job=JOB, **fields)


def executed(reason: str) -> list[dict]:
    return [{"event": "trajectory"}, {"event": "executed", "reason": reason}]


@pytest.mark.parametrize(
    ("fields", "events", "ended", "stopped"),
    [
        ({"success": True}, executed("completed"), "", 0),
        ({"success": True}, [*executed("operator_gone"), *executed("completed")], "", 1),
        ({"cause": "RobotGoneError", "why": GONE}, executed("completed"), "at rest", 0),
        ({"cause": "RobotGoneError", "why": GONE}, [], "at rest", 0),
        ({"cause": "RobotGoneError", "why": GONE}, [*executed("completed"), {"event": "trajectory"}], "moving", 0),
        ({"cause": "StoppedError", "why": "it stopped by itself (frozen): still"}, executed("frozen"), "stopped", 1),
        ({"cause": "claimed_wrongly", "why": "it is not there"}, executed("completed"), "other", 0),
    ],
)
def test_what_ended_an_episode_is_told_by_its_record_and_whether_something_moved_by_its_events(
    fields, events, ended: str, stopped: int
):
    episode = judge(record(**fields), events, stalls=7)
    assert (episode.ended, episode.stopped_motions, episode.stalls) == (ended, stopped, 7)


def test_the_figures_count_what_was_gone_on_with_apart_from_what_ended_a_run():
    episodes = [
        judge(record(success=True), [*executed("operator_gone"), *executed("completed")], 3),
        judge(record(cause="StoppedError", why="it stopped by itself (frozen): still"), executed("frozen"), 2),
        judge(record(cause="RobotGoneError", why=GONE), [], 1),
    ]
    figures = as_json(episodes, busy=4)
    assert (figures["reached"], figures["episodes"], figures["stalls"]) == (1, 3, 6)
    assert (figures["ended_at_rest"], figures["ended_moving"], figures["stopped_for_good"]) == (1, 0, 1)
    assert figures["motions_stopped_and_gone_on"] == 1
    text = as_text(figures)
    assert "1 of 3 reached through 6 stalls beside 4 busy processes" in text and GONE in text
