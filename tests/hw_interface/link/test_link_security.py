"""Links between machines: who gets in, who may do what, and what everybody else is told."""

import datetime
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.robot_side.perfect_robot import certificate, from_here
from control.errors import ConfigError, MachineError, RefusedError, RobotGoneError
from hw_interface.cell.client import CellClient
from hw_interface.link import transport
from hw_interface.link.keys import examine_keys, make_keys
from hw_interface.link.rights import may_ask
from hw_interface.link.security import ROLES, read_link_file
from hw_interface.messages.robot import InfoRequest
from hw_interface.messages.wire import encode
from tests.support.robot_side.hw_support import idle_client, robot_thread
from tests.support.robot_side.link_certificates import lasting_from_to, link
from tests.support.waiting import until

NOW = datetime.datetime.now(datetime.UTC)
DAY = datetime.timedelta(days=1)


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the keys of all roles."""
    folder = tmp_path_factory.mktemp("keys")
    make_keys(folder, ("127.0.0.1", "robot-pc"), 90, NOW)
    return folder


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keys of another authority."""
    folder = tmp_path_factory.mktemp("foreign")
    make_keys(folder, ("127.0.0.1",), 90, NOW)
    return folder


@pytest.fixture(scope="module")
def robot(keys: Path) -> Iterator[str]:
    """Endpoint of a robot that listens with TLS."""
    with robot_thread("tls/127.0.0.1:0", link(keys, "robot")) as endpoint:
        yield endpoint


def test_an_operator_may_have_motions_played_and_stopped(keys: Path, robot: str):
    with idle_client(robot, link(keys, "operator")) as client:
        motion = from_here(client, 0.5, 0.05)
        assert client.execute(motion, certificate(motion), speed=0.8).completed
        assert client.stop().mode == "stopped"
        assert client.acknowledge().mode == "idle"
        assert client.set_speed(0.5).speed_wanted == 0.5
        assert client.frames(["front"])[0].camera == "front"


def test_a_viewer_may_look_and_stop_and_is_told_at_once_what_it_may_not(keys: Path, robot: str):
    with (
        # Waiting for a time-out would last longer than a test may.
        CellClient.connect(robot, timeout=3600.0, security=link(keys, "viewer")) as viewer,
        idle_client(robot, link(keys, "operator")) as operator,
    ):
        assert viewer.frames(["side"])[0].camera == "side"
        motion = from_here(viewer, 0.5, 0.05)
        with pytest.raises(
            RefusedError, match=r"role 'viewer', which may not use 'cell/trajectory'.*\(.*operator"
        ) as no:
            viewer.execute(motion, certificate(motion))
        assert no.value.code == "no_right"
        with pytest.raises(RefusedError, match="may not use 'cell/speed'"):
            viewer.set_speed(0.5)
        assert viewer.stop("seen from afar").mode == "stopped"
        with pytest.raises(RefusedError, match="may not use 'cell/acknowledge'"):
            viewer.acknowledge()
        assert operator.state().mode == "stopped" and operator.state().motion_serial != certificate(motion).serial


def test_a_viewer_that_calls_itself_operator_has_no_more_rights(keys: Path, robot: str):
    liar = replace(link(keys, "viewer"), role="operator")
    with CellClient.connect(robot, security=liar) as client:
        motion = from_here(client, 0.5, 0.05)
        with pytest.raises(RobotGoneError, match=r"did not answer 'cell/trajectory'.*no right"):
            client.execute(motion, certificate(motion))
        assert client.state().mode == "idle"


@pytest.mark.parametrize("role", ["viewer", "camera", "operator", "ros2"])
def test_nobody_but_the_robot_can_publish_states_or_answer_for_it(keys: Path, robot: str, role):
    heard: list[bytes] = []
    with CellClient.connect(robot, security=link(keys, "operator")) as client:
        client._session.declare_subscriber(transport.STATE_KEY, lambda s: heard.append(s.payload.to_bytes()))
        session = transport.open_client_session(robot, security=link(keys, role))
        try:
            session.declare_queryable(transport.TRAJECTORY_KEY, lambda q: q.reply(q.key_expr, b"forged"))
            for _ in range(20):
                session.put(transport.STATE_KEY, b"forged")
                time.sleep(0.01)
            assert until(lambda: len(heard) > 20)
            replies = list(client._session.get(transport.TRAJECTORY_KEY, payload=encode(InfoRequest()), timeout=2.0))
        finally:
            session.close()
    assert b"forged" not in heard
    assert len(replies) == 1 and replies[0].ok is None, "only the robot's refusal of a wrong message"


def test_a_camera_shows_its_pictures_and_nothing_else(keys: Path, robot: str):
    session = transport.open_client_session(robot, security=link(keys, "camera"))
    try:
        session.declare_queryable(f"{transport.FRAME_KEY}/wrist", lambda q: q.reply(q.key_expr, b"a picture"))
        token = session.liveliness().declare_token("cell/camera/wrist")
        with CellClient.connect(robot, security=link(keys, "viewer")) as client:
            seen = client._session.liveliness().get("cell/camera/*", timeout=2.0)
            assert [str(s.ok.key_expr) for s in seen if s.ok] == ["cell/camera/wrist"]
            replies = client._session.get(f"{transport.FRAME_KEY}/wrist", timeout=2.0)
            assert b"a picture" in [r.ok.payload.to_bytes() for r in replies if r.ok]
        token.undeclare()
        for key in (transport.STOP_KEY, transport.TRAJECTORY_KEY, transport.ACKNOWLEDGE_KEY):
            assert list(session.get(key, payload=b"", timeout=2.0)) == []
    finally:
        session.close()


def test_topics_of_ros_2_reach_ros_2_alone_and_it_cannot_move_the_robot(keys: Path, robot: str):
    with ExitStack() as stack:

        def session(role):
            opened = transport.open_client_session(robot, security=link(keys, role))
            stack.callback(opened.close)
            return opened

        view, bridge, viewer = session("ros2"), session("ros2"), session("viewer")
        heard: dict[str, list[str]] = {"bridge": [], "viewer": [], "states": []}
        announcement = "@/0a1b/@ros2_lv/MP/joint_states/sensor_msgs§msg§JointState/:1:0:0,10"
        token = view.liveliness().declare_token(announcement)
        bridge.declare_subscriber("joint_states", lambda s: heard["bridge"].append(str(s.key_expr)))
        viewer.declare_subscriber("joint_states", lambda s: heard["viewer"].append(str(s.key_expr)))
        view.declare_subscriber(transport.STATE_KEY, lambda s: heard["states"].append(str(s.key_expr)))
        time.sleep(0.2)
        assert until(lambda: view.put("joint_states", b"a message") or len(heard["bridge"]) > 5)
        assert until(lambda: len(heard["states"]) > 3)
        assert heard["viewer"] == []
        announced = bridge.liveliness().get("@/*/@ros2_lv/**", timeout=2.0)
        assert [str(s.ok.key_expr) for s in announced if s.ok] == [announcement]
        token.undeclare()
        for key in (transport.STOP_KEY, transport.SPEED_KEY, transport.TRAJECTORY_KEY, transport.ACKNOWLEDGE_KEY):
            assert list(bridge.get(key, payload=b"", timeout=2.0)) == []


def refusal(endpoint: str, security) -> str:
    with pytest.raises((RobotGoneError, ConfigError)) as caught:
        transport.open_client_session(endpoint, 0.6, security).close()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_strangers_are_not_let_in_and_are_told_why(keys: Path, foreign: Path, robot: str):
    operator, stranger = link(keys, "operator"), link(foreign, "operator")
    assert "does not accept our certificate" in (said := refusal(robot, replace(stranger, ca=operator.ca)))
    assert "unknown ca" in said
    assert "its certificate is not accepted here: unable to get local issuer" in refusal(robot, stranger)
    expired = lasting_from_to(operator, NOW - 9 * DAY, NOW - 2 * DAY)
    assert "(certificate expired); `replan security show`" in refusal(robot, expired)
    assert "needs certificates: give a link file" in refusal(robot, None)
    plain = "tcp/" + robot.removeprefix("tls/")
    assert "it speaks TLS only: write tls/" in refusal(plain, None)
    assert "is plain TCP, but a link file was given" in refusal(plain, operator)
    with robot_thread() as unprotected:
        assert "does not answer a TLS handshake" in refusal("tls/" + unprotected.removeprefix("tcp/"), operator)


def test_a_server_is_only_trusted_under_its_own_name_and_with_a_certificate_to_serve(keys: Path, tmp_path: Path):
    make_keys(tmp_path / "other", ("robot-pc",), 90, NOW)
    with robot_thread("tls/127.0.0.1:0", link(tmp_path / "other", "robot")) as endpoint:
        assert "IP address mismatch" in refusal(endpoint, link(tmp_path / "other", "operator"))
    with pytest.raises(ConfigError, match="has role 'viewer'; only robot and router may listen"):
        transport.open_robot_session("tls/127.0.0.1:0", link(keys, "viewer"))
    # What poses as the robot with a viewer's certificate is not believed.
    forger = replace(link(keys, "viewer"), role="robot")
    with robot_thread("tls/127.0.0.1:0", forger) as endpoint:
        assert "its certificate is not accepted here" in refusal(endpoint, link(keys, "operator"))


def test_nothing_listens_beyond_this_machine_unless_it_is_told_to():
    with robot_thread() as endpoint:
        port = int(endpoint.rpartition(":")[2])
        with open("/proc/net/tcp") as table:
            listening = [line.split()[1] for line in table if f":{port:04X} " in line and line.split()[3] == "0A"]
        assert listening == [f"0100007F:{port:04X}"]  # 127.0.0.1 alone
    with pytest.raises(ConfigError, match="neither encrypted nor authenticated"):
        transport.open_robot_session("tcp/0.0.0.0:0")


def test_every_role_that_is_offered_has_its_files_and_private_keys_are_private(keys: Path):
    for role in ROLES:
        security = link(keys, role)
        assert stat.S_IMODE(security.key.stat().st_mode) == 0o600
        assert [c.trouble for c in examine_keys(security, NOW)] == ["", ""]
    assert stat.S_IMODE((keys / "ca-key.pem").stat().st_mode) == 0o600
    assert examine_keys(link(keys, "router"), NOW)[1].hosts == ("127.0.0.1", "robot-pc")
    assert examine_keys(link(keys, "viewer"), NOW)[1].hosts == ()


def test_keys_are_never_overwritten(keys: Path):
    before = {path: path.read_bytes() for path in keys.iterdir()}
    with pytest.raises(ConfigError, match=r"holds ca.pem already; keys are never overwritten"):
        make_keys(keys, ("127.0.0.1",), 90, NOW)
    assert before == {path: path.read_bytes() for path in keys.iterdir()}


@pytest.mark.parametrize(
    ("hosts", "days", "text"),
    [((), 90, "at least one --host"), (("robot pc",), 90, "neither a host name nor"), (("a",), 0, "0 days")],
)
def test_keys_that_could_not_be_used_are_not_made(tmp_path: Path, hosts, days, text):
    with pytest.raises(ConfigError, match=text):
        make_keys(tmp_path / "new", hosts, days, NOW)
    assert not (tmp_path / "new").exists()


def test_what_is_wrong_with_a_certificate_is_named(keys: Path, foreign: Path):
    operator = link(keys, "operator")

    def trouble(security) -> str:
        return examine_keys(security, NOW)[1].trouble

    assert "expired on" in trouble(lasting_from_to(operator, NOW - 9 * DAY, NOW - 2 * DAY))
    assert "in 4 days; make new keys in time" in trouble(lasting_from_to(operator, NOW - 9 * DAY, NOW + 4.5 * DAY))
    assert "holds only from" in trouble(lasting_from_to(operator, NOW + 2 * DAY, NOW + 60 * DAY))
    assert "was not signed by" in trouble(replace(link(foreign, "operator"), ca=operator.ca))
    assert "does not belong to the key" in trouble(replace(operator, key=link(keys, "viewer").key))
    assert "is for the role 'operator'; the link file says 'viewer'" in trouble(replace(operator, role="viewer"))
    operator.key.chmod(0o644)
    try:
        assert "can be read by others; run: chmod 600" in trouble(operator)
    finally:
        operator.key.chmod(0o600)
    with pytest.raises(ConfigError, match="is no certificate in PEM"):
        trouble(replace(operator, certificate=operator.key))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ("colour: red\n", "key 'colour'"),
        ("role: king\n", "key 'role'"),
        ("key: gone.pem\n", "there is no file .*gone.pem' \\(key\\)"),
    ],
)
def test_a_link_file_that_cannot_be_right_is_refused_by_key(keys: Path, tmp_path: Path, change: str, text: str):
    content = {line.split(":")[0]: line for line in (keys / "viewer.yaml").read_text().splitlines(keepends=True)}
    content[change.split(":")[0]] = change
    path = keys / "changed.yaml"
    path.write_text("".join(content.values()))
    with pytest.raises(ConfigError, match=text):
        read_link_file(path)


def test_rights_are_as_the_guide_says():
    may = {key: [role for role in ROLES if may_ask(role, f"cell/{key}")] for key in ("info", "stop", "trajectory")}
    assert may == {
        "info": ["robot", "camera", "operator", "viewer", "ros2"],
        "stop": ["robot", "operator", "viewer"],
        "trajectory": ["robot", "operator"],
    }


def test_a_router_has_the_same_rights_and_one_robot(keys: Path):
    session, endpoint = transport.open_listening_session("tls/127.0.0.1:0", link(keys, "router"))
    try:
        with robot_thread(endpoint, link(keys, "robot"), connect=True) as where:
            assert where == endpoint
            with idle_client(endpoint, link(keys, "operator")) as client:
                motion = from_here(client, 0.5, 0.05)
                assert client.execute(motion, certificate(motion)).completed
            with CellClient.connect(endpoint, security=link(keys, "viewer")) as viewer:
                with pytest.raises(RefusedError, match="role 'viewer', which may not use 'cell/acknowledge'"):
                    viewer.acknowledge()
                assert viewer.stop().mode == "stopped"
            with (
                pytest.raises(MachineError, match="has a robot already"),
                robot_thread(endpoint, link(keys, "robot"), connect=True),
            ):
                pass
        with pytest.raises(ConfigError, match="has role 'operator'; a robot process needs one with role 'robot'"):
            transport.open_robot_session(endpoint, link(keys, "operator"), connect=True)
    finally:
        session.close()


def test_a_router_that_is_not_there_is_told():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(RobotGoneError, match=r"no router answers at .*start one \(replan router\)"):
        transport.open_robot_session(f"tcp/127.0.0.1:{port}", connect=True)
