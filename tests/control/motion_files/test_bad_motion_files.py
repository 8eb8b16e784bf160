"""A motion file that cannot mean a motion is refused in one line that says what is wrong, where, and what is valid."""

import io
import os
import re
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from control.errors import MotionFileError
from control.motion_files.contents import MAX_DURATION, checked
from control.motion_files.reading import read_motion
from control.motion_files.resampling import to_trajectory
from control.motion_files.trajectory_file import write_trajectory
from control.robot.limits import JOINT_NAMES, REST_Q, panda_limits
from replan.errors import USAGE, exit_code
from tests.control.trajectory.test_trajectory import some_trajectory
from tests.support.robot_side.ros2_messages import (
    STATE,
    TRAJECTORY,
    joint_state,
    write_mcap,
)
from tests.support.scenes.motion_files import (
    STEP,
    Motion,
    as_motion,
    at_rest,
    columns,
    plain_arrays,
    planned,
    refused,
    rows,
    there_and_back,
    write_csv,
    write_npz,
)

# -- what is wrong with a file -----------------------------------------------------------------------------------------


def test_a_motion_file_error_is_a_usage_error():
    assert exit_code(MotionFileError("x")) == USAGE


def test_paths_that_are_no_motion_files_are_refused(tmp_path):
    assert "there is no file" in refused(tmp_path / "absent.csv")
    assert "is a folder; give a motion file (.npz, .csv, .mcap)" in refused(tmp_path)
    (tmp_path / "m.bag").write_text("x")
    assert "is no known kind of motion file; valid endings are .npz, .csv, .mcap" in refused(tmp_path / "m.bag")
    os.mkfifo(tmp_path / "pipe.csv")
    assert "is not an ordinary file" in refused(tmp_path / "pipe.csv")
    (tmp_path / "loop.csv").symlink_to(tmp_path / "loop.csv")
    assert re.search("there is no file|cannot be read", refused(tmp_path / "loop.csv"))
    for ending in ("csv", "npz", "mcap"):
        (tmp_path / f"empty.{ending}").touch()
        assert "is empty" in refused(tmp_path / f"empty.{ending}")


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="needs a file that cannot be read even by root")
@pytest.mark.parametrize("ending", ["csv", "npz", "mcap"])
def test_a_file_that_cannot_be_read_is_refused(tmp_path, ending):
    (tmp_path / f"m.{ending}").symlink_to("/proc/self/mem")
    assert "cannot be read: Input/output error" in refused(tmp_path / f"m.{ending}")


def test_a_topic_is_for_recordings_only(tmp_path):
    path = write_csv(tmp_path / "m.csv", columns(there_and_back(rows(0.5))))
    assert "has no topics to choose from" in refused(path, topic="/plan")


def changed_csv(tmp_path: Path, line: int, old: str, new: str) -> Path:
    """A sound file with something replaced in one line, counted from 1."""
    path = write_csv(tmp_path / "m.csv", columns(there_and_back(rows(0.5)), derivatives=1), digits=4)
    lines = path.read_text().splitlines()
    assert old in lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new)
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(
    ("line", "old", "new", "message"),
    [
        (1, "panda_joint4,", "panda_elbow,", "line 1: unknown column 'panda_elbow'; valid are a time column (t, time"),
        (1, "panda_joint4,", "panda_joint3,", "line 1: column 'panda_joint3' stands there twice"),
        (1, "panda_joint4,", "fr3_joint4,", "mixes joint names 'fr3_joint..' and 'panda_joint..'"),
        (1, "panda_joint4,", "gripper_width,", "lacks joint panda_joint4; it has 6 of the arm's 7 joints"),
        (1, "t,", "gripper_width,", "line 1 has no time column; it needs one of t, time, time_from_start, in [s]"),
        (1, ",panda_joint4_velocity", ",time", "line 1 has 2 time columns"),
        (1, "panda_joint4_velocity", "fr3_joint4_velocity", "'panda_joint4_velocity' is missing"),
        (1, ",", ";", "line 1: columns must be separated by commas"),
        (1, "t,panda", "# t,panda", "line 2 holds numbers where a header is needed (one that begins with # is"),
        (1, "_velocity", "_acceleration", "has accelerations but no velocities"),
        (4, "1.0854", "abc", "line 4, column 'panda_joint7': 'abc' is not a number"),
        (4, "1.0000,", "1.0000,,", "line 4 has 16 columns, the header has 15"),
        (4, "-0.6354,", ",", "line 4, column 'panda_joint2': there is no number"),
        (4, "-0.6354", "nan", "line 4: the position of panda_joint2 is nan"),
        (4, "-0.6354", "-inf", "line 4: the position of panda_joint2 is -inf"),
        (4, "-0.6354", "1e300", "line 4: the position of panda_joint2 is 1e+300 rad; beyond 1000 rad nothing is read"),
        (
            4,
            "1.0000",
            "0.5",
            "line 4: time 0.5 is the same time as that of the row before it (0.5); times must",
        ),
        (4, "1.0000", "0.4", "line 4: time 0.4 is earlier than that of the row before it (0.5)"),
        (4, "1.0000", "nan", "line 4: the time is nan"),
        (4, "1.0000,", '1.0000,"', "line 4 is not valid CSV: unexpected end of data"),
    ],
)
def test_what_is_wrong_in_a_csv_file_is_named_by_line_and_column(tmp_path, line, old, new, message):
    assert message in refused(changed_csv(tmp_path, line, old, new))


def test_files_with_too_little_in_them_are_refused(tmp_path):
    (tmp_path / "m.csv").write_text("# nothing\n\n")
    assert "is empty; it needs a header line" in refused(tmp_path / "m.csv")
    some = columns(there_and_back(np.zeros(1)))
    assert "has one row of numbers; a motion has at least 2" in refused(write_csv(tmp_path / "m.csv", some))
    (tmp_path / "m.csv").write_text(",".join(name for name, _ in some))
    assert "has no rows of numbers" in refused(tmp_path / "m.csv")
    truth = there_and_back(np.zeros(1))
    path = write_mcap(tmp_path / "m.mcap", [("/plan", TRAJECTORY, planned(truth))])
    assert "has one row of numbers" in refused(path)
    path = write_mcap(tmp_path / "m.mcap", [("/plan", TRAJECTORY, {**planned(truth), "points": []})])
    assert "message 0 of topic '/plan' has no points" in refused(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint_names": None}, "lacks joint_names; valid are t or time or times; q or positions; "),
        ({"q": None}, "lacks q or positions; valid are"),
        ({"torque": np.zeros(3)}, "has an unknown array 'torque'; valid are t or time or times;"),
        ({"times": np.zeros(3)}, "has both 't' and 'times'; give one of them"),
        (
            {"q": np.zeros((11, 6))},
            "array 'q' has shape (11, 6); it needs (11, 7): rows of 't', columns of",
        ),
        ({"q": np.zeros((10, 7))}, "array 'q' has shape (10, 7); it needs (11, 7)"),
        ({"t": np.zeros((11, 1))}, "array 't' has shape (11, 1); it needs (n,), one time a row"),
        ({"q": np.full((11, 7), "a")}, "array 'q' holds <U1; it must hold numbers"),
        ({"q": np.zeros((11, 7), complex)}, "array 'q' holds complex128; it must hold numbers"),
        ({"q": np.full((11, 7), None)}, "array 'q' holds pickled objects, which are never loaded"),
        ({"joint_names": np.arange(7)}, "joint_names is int64 of shape (7,); it needs one string per column of q"),
        ({"joint_names": np.array(["a\nb"] * 7)}, "has a joint 'a?b'; valid are panda_joint1 .. panda_joint7"),
        ({"joint_names": np.array([*JOINT_NAMES[:6], "panda_joint1"])}, "has joint 'panda_joint1' twice"),
        ({"joint_names": np.array(JOINT_NAMES[:6])}, "lacks joint panda_joint7; it has 6 of the arm's 7 joints"),
        ({"gripper_width": np.full(11, 80.0)}, "row 0: the gripper width is 80 m; it looks like millimetres"),
        ({"gripper_width": np.full(11, -0.02)}, "row 0: the gripper width is -0.02 m; it cannot be negative"),
        ({"gripper_force": np.zeros(11)}, "has a gripper_force but no gripper width"),
        ({"t": np.zeros(11)}, "row 1: time 0 is the same time as that of the row before it (0)"),
    ],
)
def test_what_is_wrong_in_an_npz_file_is_named_by_array_and_row(tmp_path, changes, message):
    arrays = {**plain_arrays(there_and_back(rows(0.5))), **changes}
    path = write_npz(tmp_path / "m.npz", **{key: array for key, array in arrays.items() if array is not None})
    assert message in refused(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint_names": [*JOINT_NAMES[:6], "elbow"]}, "has a joint 'elbow'; valid are"),
        ({"joint_names": list(JOINT_NAMES[:6])}, "lacks joint panda_joint7; it has 6 of the arm's 7 joints"),
        ({"joint_names": [*JOINT_NAMES, "panda_finger_joint1"]}, "point 0 has 7 positions; it needs 8, one per joint"),
        ({"positions": []}, "point 3 has 0 positions; it needs 7, one per joint name"),
        ({"velocities": []}, "point 3 has 0 velocities; it needs 7, one per joint name, or none in all points"),
        ({"positions": [float("nan")] * 7}, "point 3: the position of panda_joint1 is nan"),
        (
            {"time_from_start": {"sec": 0, "nanosec": 0}},
            "point 3: time 0 is earlier than that of the row",
        ),
    ],
)
def test_what_is_wrong_in_a_ros_2_trajectory_is_named_by_point(tmp_path, changes, message):
    whole = planned(there_and_back(rows(0.5)))
    if "joint_names" in changes:
        whole.update(changes)
    else:
        whole["points"][3].update(changes)
    assert message in refused(write_mcap(tmp_path / "m.mcap", [("/plan", TRAJECTORY, whole)]))


def test_recordings_without_usable_stamps_or_joints_are_refused(tmp_path):
    states = [("/s", STATE, joint_state(0.0, JOINT_NAMES, np.array(REST_Q)))] * 2
    assert "message 1: time 0 is the same time" in refused(write_mcap(tmp_path / "m.mcap", states))
    other = [("/s", STATE, joint_state(k / 10, ["wheel"], np.zeros(1))) for k in range(3)]
    assert "has the arm's joints, but wheel; valid are" in refused(write_mcap(tmp_path / "m.mcap", other))
    short = [("/s", STATE, joint_state(k / 10, JOINT_NAMES, np.zeros(6))) for k in range(3)]
    assert "message 0 of topic '/s' has 7 names but 6 positions" in refused(write_mcap(tmp_path / "m.mcap", short))


# -- units -------------------------------------------------------------------------------------------------------------


def test_degrees_are_recognised_in_positions_velocities_and_accelerations():
    motion = there_and_back(rows(0.1))
    for changes, message in (
        (
            {"q": np.rad2deg(motion.q)},
            "line 2: panda_joint4 is at -135: positions look like degrees: multiply by",
        ),
        (
            {"qd": np.rad2deg(motion.qd)},
            "velocities are 57.* times what the rows before them say: they look like",
        ),
        ({"qdd": np.rad2deg(motion.qdd)}, "accelerations are 5.* times .* they look like degrees"),
    ):
        with pytest.raises(MotionFileError, match=message):
            checked(as_motion(replace(motion, **changes), derivatives=2))


def test_no_valid_motion_passes_for_degrees_and_one_out_of_range_is_for_the_checks_to_find():
    limits, rng = panda_limits(), np.random.default_rng(0)
    motion = there_and_back(rows(0.05))
    for _ in range(200):
        low, high = rng.uniform(limits.q_min, limits.q_max, (2, 7))
        share = (motion.q[:, :1] - REST_Q[0]) / STEP[0]
        q = low + share * (high - low)
        qd = motion.qd[:, :1] / STEP[0] * (high - low)
        checked(as_motion(replace(motion, q=q, qd=qd), derivatives=1))
    wound = motion.q.copy()
    wound[:, 6] += 4 * np.pi
    checked(as_motion(replace(motion, q=wound)))


@pytest.mark.parametrize(("unit", "factor"), [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)])
@pytest.mark.parametrize(("step", "seconds"), [(0.001, 5.0), (0.01, 5.0), (0.001, 0.15)])
def test_times_in_another_unit_are_named(tmp_path, unit, factor, step, seconds):
    motion = there_and_back(rows(step) + 0.5)
    motion = replace(motion, times=motion.times * factor)
    kept = slice(0, round(seconds / step) + 1)
    path = write_csv(tmp_path / "m.csv", [(name, column[kept]) for name, column in columns(motion)])
    assert f"times look like {unit} (rows are {step * factor:.6g} apart): divide them by {factor:.0e}" in refused(path)


def test_slow_motions_are_not_taken_for_milliseconds(tmp_path):
    for stretch in (5.0, 20.0):
        coarse = there_and_back(rows(0.25))
        slow = replace(coarse, times=coarse.times * stretch)
        assert read_motion(write_csv(tmp_path / "m.csv", columns(slow))).duration == pytest.approx(5.0 * stretch)
    resting = replace(coarse, times=coarse.times * 4, q=np.tile(REST_Q, (len(coarse.times), 1)))
    assert read_motion(write_csv(tmp_path / "m.csv", columns(resting))).duration == pytest.approx(20.0)


# -- size --------------------------------------------------------------------------------------------------------------


def test_a_motion_of_ten_minutes_is_refused_soon_in_every_format(tmp_path):
    motion = there_and_back(rows(0.02))
    long = there_and_back(rows(0.1)[:-1])
    times = np.arange(6000) * 0.1
    long = Motion(times, *(np.concatenate([a] * 120) for a in (long.q, long.qd, long.qdd, long.width)))
    said = f"s after the first row, at most {MAX_DURATION:g} s are read; cut it into shorter motions"
    assert said in refused(write_csv(tmp_path / "m.csv", columns(long)))
    assert said in refused(write_npz(tmp_path / "m.npz", **plain_arrays(long)))
    assert said in refused(write_mcap(tmp_path / "m.mcap", [("/plan", TRAJECTORY, planned(long, derivatives=0))]))
    states = [("/s", STATE, joint_state(float(k), JOINT_NAMES, motion.q[k % 250])) for k in range(600)]
    path = write_mcap(tmp_path / "s.mcap", states)
    assert "message 181 is 181 s after the first row" in refused(path)
    write_trajectory(tmp_path / "t.npz", at_rest(180_002))
    assert "row 180001 is 180.001 s after the first row" in refused(tmp_path / "t.npz")


def test_a_file_is_not_read_beyond_what_is_accepted(tmp_path):
    line = ",".join(["{:.6f}", *["0.1"] * 7]) + "\n"
    path = tmp_path / "m.csv"
    with path.open("w") as file:
        file.write("t," + ",".join(JOINT_NAMES) + "\n")
        file.writelines(line.format(k * 0.5) for k in range(400))
        file.truncate(2**40)  # a terabyte that takes no space
    began = time.process_time()
    assert "line 363 is 180.5 s after the first row" in refused(path)
    with path.open("w") as file:
        file.truncate(2**40)
    assert "line 1 has more than 20000 characters" in refused(path)
    assert time.process_time() - began < 2.0


def test_an_npz_array_that_would_fill_the_memory_is_refused_by_its_header(tmp_path):
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**11, 7)})
    with zipfile.ZipFile(tmp_path / "m.npz", "w") as archive:
        archive.writestr("q.npy", head.getvalue())
    assert "array 'q' has shape (100000000000, 7); a motion has at most 360000 rows" in refused(tmp_path / "m.npz")


def test_eight_seconds_at_1_khz_are_read_and_resampled_fast(tmp_path):
    times = np.arange(8001) * 1e-3
    motion = there_and_back(times)
    paths = [
        write_csv(tmp_path / "m.csv", columns(motion, derivatives=2, width=True)),
        write_npz(tmp_path / "m.npz", **plain_arrays(motion)),
        write_mcap(tmp_path / "m.mcap", [("/plan", TRAJECTORY, planned(motion))]),
    ]
    for path in paths:
        spent = []
        for _ in range(3):
            began = time.process_time()
            to_trajectory(read_motion(path))
            spent.append(time.process_time() - began)
        assert min(spent) < 0.6, (path, spent)


# -- damage ------------------------------------------------------------------------------------------------------------


def sound_files(folder: Path) -> list[Path]:
    """One small file of each kind, the recordings in several chunks."""
    motion = there_and_back(rows(0.05))
    write_trajectory(folder / "own.npz", some_trajectory())
    message = ("/plan", TRAJECTORY, planned(motion))
    states = [("/s", STATE, joint_state(t, JOINT_NAMES, q)) for t, q in zip(motion.times, motion.q, strict=True)]
    return [
        folder / "own.npz",
        write_npz(folder / "plain.npz", **plain_arrays(motion)),
        write_csv(folder / "m.csv", columns(motion, 1, width=True), digits=5),
        write_mcap(folder / "plan.mcap", [message]),
        write_mcap(folder / "states.mcap", states, chunk_size=2000),
    ]


def test_a_cut_off_recording_is_refused_wherever_it_ends(tmp_path):
    path = sound_files(tmp_path)[-1]
    whole = path.read_bytes()
    for share in (0.05, 0.5, 0.9, 0.999):
        path.write_bytes(whole[: int(len(whole) * share)])
        assert "is cut off: a complete MCAP file ends otherwise; `mcap recover` keeps what is whole" in refused(path)
    path.write_bytes(whole[:4])
    assert "is not an MCAP file: it does not begin like one" in refused(path)


@pytest.mark.parametrize("ending", ["csv", "npz", "mcap"])
def test_junk_is_refused(tmp_path, ending):
    path = tmp_path / f"m.{ending}"
    rng = np.random.default_rng(0)
    for _ in range(20):
        path.write_bytes(rng.bytes(int(rng.integers(1, 4000))))
        refused(path)
    path.write_bytes(b"\x89MCAP0\r\n" + rng.bytes(500) + b"\x89MCAP0\r\n")
    refused(path)


def test_a_damaged_definition_of_a_message_is_refused_and_nothing_is_printed(tmp_path, capfd):
    message = ("/plan", TRAJECTORY, planned(there_and_back(rows(0.5))))
    path = write_mcap(tmp_path / "m.mcap", [message], compression=0, enable_crcs=False)
    path.write_bytes(path.read_bytes().replace(b"float64[] velocities", b"flo!t64[] velocities"))
    assert "is damaged: " in refused(path)
    assert capfd.readouterr() == ("", "")


def test_damage_anywhere_is_an_error_in_one_line_or_a_valid_motion(tmp_path):
    rng = np.random.default_rng(0)
    for path in sound_files(tmp_path):
        whole = path.read_bytes()
        read_motion(path)
        refusals = 0
        for trial in range(150):
            data = bytearray(whole)
            if trial % 3 == 0:
                data = data[: int(rng.integers(len(data)))]
            else:
                for at in rng.integers(len(data), size=int(rng.integers(1, 6))):
                    data[at] ^= 1 << int(rng.integers(8))
            path.write_bytes(data)
            try:
                motion = read_motion(path)
            except MotionFileError as error:
                refusals += 1
                assert "\n" not in str(error) and str(path) in str(error)
            else:
                assert len(to_trajectory(motion).q) >= 2
        assert refusals > 20, path
