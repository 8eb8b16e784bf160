"""Certificates as files: they come back bit for bit, and whatever is not a certificate is refused by field."""

import json
from dataclasses import replace

import pytest

from benchmarks.robot_side.perfect_robot import certificate, swing
from control.errors import ConfigError
from control.safety.certificate_file import read_certificate, write_certificate

CERTIFICATE = replace(certificate(swing(0.1, 0.01)), issued=0.1 + 0.2, expires=1700000123.4567891)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "certificate.json"
    write_certificate(path, CERTIFICATE)
    return path


def test_a_certificate_comes_back_bit_for_bit(file):
    assert read_certificate(file) == CERTIFICATE


def test_the_file_is_json_that_names_every_field_and_what_it_is(file):
    document = json.loads(file.read_text())
    assert document.pop("format") == "replan-certificate"
    assert document.pop("version") == 1
    assert document == CERTIFICATE.__dict__


def test_an_existing_file_is_replaced(file):
    other = replace(CERTIFICATE, serial="another")
    write_certificate(file, other)
    assert read_certificate(file) == other


@pytest.mark.parametrize("field", [*CERTIFICATE.__dict__, "format", "version"])
def test_a_missing_field_is_named(file, field):
    document = json.loads(file.read_text())
    del document[field]
    file.write_text(json.dumps(document))
    with pytest.raises(ConfigError, match=f"certificate.json' is no certificate: field '{field}': Field required"):
        read_certificate(file)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"format": "a letter"}, "format"),
        ({"version": 2}, "version"),
        ({"serial": ""}, "serial"),
        ({"serial": 7}, "serial"),
        ({"trajectory_hash": "abc"}, "trajectory_hash"),
        ({"profile": None}, "profile"),
        ({"firmware": ["panda"]}, "firmware"),
        ({"firmware": "x" * 65}, "firmware"),
        ({"issued": "1700000000.0"}, "issued"),
        ({"issued": True}, "issued"),
        ({"expires": float("nan")}, "expires"),
        ({"scene_stamp": float("inf")}, "scene_stamp"),
        ({"force": True}, "force"),
    ],
)
def test_a_field_that_is_not_valid_is_named(file, change, field):
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    with pytest.raises(ConfigError, match=f"certificate.json' is no certificate: field '{field}': "):
        read_certificate(file)


@pytest.mark.parametrize("text", ["", "{", "[]", "7", "null", "serial: abc", "\udcff"])
def test_what_is_not_a_json_object_is_no_certificate(file, text):
    file.write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(ConfigError, match="is no certificate: it is not a JSON object of its fields"):
        read_certificate(file)


def test_every_truncation_is_refused(file):
    data = file.read_bytes().rstrip()
    for length in range(0, len(data), 7):
        file.write_bytes(data[:length])
        with pytest.raises(ConfigError, match="is no certificate"):
            read_certificate(file)


def test_a_file_that_is_far_too_large_is_not_parsed(file):
    file.write_bytes(b" " * (1 << 17))
    with pytest.raises(ConfigError, match="has 131072 bytes, a certificate has at most 65536"):
        read_certificate(file)


def test_a_file_that_is_not_there_or_cannot_be_written_is_said(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot read the certificate .*No such file.* came with the verdict"):
        read_certificate(tmp_path / "none.json")
    with pytest.raises(ConfigError, match="cannot read the certificate"):
        read_certificate(tmp_path)
    with pytest.raises(ConfigError, match=r"cannot write the certificate .*No such file"):
        write_certificate(tmp_path / "no folder" / "certificate.json", CERTIFICATE)


def test_a_certificate_that_could_not_be_read_again_is_not_written(tmp_path):
    path = tmp_path / "certificate.json"
    with pytest.raises(ConfigError, match="cannot be written: field 'expires'"):
        write_certificate(path, replace(CERTIFICATE, expires=float("inf")))
    assert not path.exists()
