"""Certificates and the router's rules, without a bus: names and permissions."""

from __future__ import annotations

import stat
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import pytest
from cryptography import x509

from edc_swarm.errors import InputError
from processes.bus.address import check_endpoint, parse_endpoint
from processes.bus.credentials import CERTIFIED
from processes.host.certificates import write_certificates
from processes.host.security import check_security, secure
from processes.services.access_rules import access_control
from processes.services.router import RouterAccess

UAVS = ["u001", "u002"]
ANSWERING = [*UAVS, "operator", "viz", "ground"]
"""Publishers, which answer requests for retransmission."""


FLOWS = {
    "says": "ingress put",
    "subscribes": "ingress declare_subscriber",
    "hears": "egress put",
    "asks": "ingress query",
    "is answered": "egress reply",
    "offers answers": "ingress declare_queryable",
    "is asked": "egress query",
    "answers": "ingress reply",
    "lives": "ingress liveliness_token",
    "gives up": "ingress liveliness_token",
    "watches": "ingress declare_liveliness_subscriber",
    "sees the living": "egress liveliness_token",
    "looks for missions": "ingress liveliness_query",
}
"""Subject of each rule, by the words in its id."""
FINDS_THE_MISSION = "*/alive/operator/* -/alive/gave-up"
ROLES_MAY = {
    "operator says": "m/mission m/event/operator m/goal/operator/to/*",
    "operator hears": "m/uav/*/fix m/head/*/report m/head/*/command/* m/event/*",
    "operator asks": "m/mission m/orders/recorder",
    "operator answers": "m/mission m/event/operator m/claims m/orders/* m/again/operator/*",
    "operator lives": "m/alive/operator/*",
    "operator gives up": "-/alive/giving-up/*",
    "operator watches": "m/alive/**",
    "operator looks for missions": "*/alive/**",
    "recorder says": "m/event/recorder",
    "recorder hears": "m/**",
    "recorder asks": "m/orders/recorder m/again/*/*",
    "recorder answers": "m/mission m/orders/recorder",
    "recorder lives": "m/alive/recorder/*",
    "recorder watches": FINDS_THE_MISSION,
    "ground says": "m/event/ground",
    "ground hears": "m/mission m/uav/*/fix m/event/*",
    "ground asks": "m/mission",
    "ground answers": "m/again/ground/*",
    "ground lives": "m/alive/ground/*",
    "viz says": "m/event/viz m/viz/**",
    "viz hears": "m/mission m/uav/** m/head/** m/event/*",
    "viz asks": "m/mission m/event/operator m/orders/viz m/orders/live",
    "viz answers": "m/again/viz/*",
    "viz lives": "m/alive/viz/*",
    "viz watches": FINDS_THE_MISSION,
    "join hears": "m/event/operator",
    "join asks": "m/claims",
    "join lives": "m/alive/join/*",
    "join watches": FINDS_THE_MISSION,
}
"""All permissions of roles, below `swarm/`; one rule names a permission that has two or three."""
SAME = {
    "subscribes": "hears",
    "is answered": "asks",
    "offers answers": "answers",
    "is asked": "answers",
    "sees the living": "watches",
}


def certificate(folder: Path, name: str) -> x509.Certificate:
    """Read a certificate from its file."""
    return x509.load_pem_x509_certificate((folder / f"{name}.pem").read_bytes())


def test_everybody_gets_a_certificate_in_its_own_name(tmp_path: Path) -> None:
    """The one authority signs for a month and for one use; only the owner can read the keys."""
    folder = tmp_path / "certs"
    write_certificates(folder, UAVS, hosts=["swarm.example", "10.0.0.7"])
    authority = certificate(folder, "ca")
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert not (folder / "ca.key").exists()
    for name in (*CERTIFIED, *UAVS):
        made = certificate(folder, name)
        made.verify_directly_issued_by(authority)
        assert made.subject.rfc4514_string() == f"CN={name}"
        assert timedelta(days=30) <= made.not_valid_after_utc - made.not_valid_before_utc < timedelta(days=31)
        assert made.not_valid_before_utc < datetime.now(UTC)
        assert stat.S_IMODE((folder / f"{name}.key").stat().st_mode) == 0o600
        uses = made.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        assert (x509.oid.ExtendedKeyUsageOID.SERVER_AUTH in uses) is (name == "router")
    names = certificate(folder, "router").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["localhost", "swarm.example"]
    assert [str(ip) for ip in names.get_values_for_type(x509.IPAddress)] == ["127.0.0.1", "::1", "10.0.0.7"]


def test_certificates_are_replaced_only_by_force(tmp_path: Path) -> None:
    """The command does not change a folder with any file in it."""
    write_certificates(tmp_path / "certs", UAVS)
    before = (tmp_path / "certs" / "u001.key").read_bytes()
    with pytest.raises(InputError, match="a new or empty folder"):
        write_certificates(tmp_path / "certs", UAVS)
    assert (tmp_path / "certs" / "u001.key").read_bytes() == before
    write_certificates(tmp_path / "certs", UAVS, force=True)
    assert (tmp_path / "certs" / "u001.key").read_bytes() != before


def test_a_given_folder_must_have_everybody(tmp_path: Path) -> None:
    """The error names the missing certificate before any process starts."""
    write_certificates(tmp_path / "certs", UAVS)
    with pytest.raises(InputError, match=r"--certs = .*u003\.pem is missing"):
        secure(tmp_path / "certs", tmp_path, "m", [*UAVS, "u003"], [], [*UAVS, "u003"])
    made = secure(tmp_path / "certs", tmp_path, "m", [*UAVS, "u003"], [], UAVS)
    access = msgspec.json.decode(Path(made.access).read_bytes(), type=RouterAccess)
    assert access == RouterAccess(certs=str(tmp_path / "certs"), mission="m", uavs=[*UAVS, "u003"])
    (tmp_path / "certs" / "viz.key").unlink()
    with pytest.raises(InputError, match=r"--certs = .*viz\.key is missing"):
        secure(tmp_path / "certs", tmp_path, "m", UAVS, [], UAVS)


def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error names the missing package before any process starts."""
    check_security("--secure")
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"pip install .*\[secure\]"):
        check_security("--secure")


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (["certs", "--uavs", "0"], "--uavs"),
        (["certs", "--uavs", "10001"], "--uavs"),
        (["certs", "--days", "0"], "--days"),
        (["certs", "--host", "a b"], "--host"),
        (["certs", "--out", "/proc/certs"], "--out"),
        (["certs", "nowhere.toml"], "mission file"),
        (["run", "--certs", "somewhere"], "--certs"),
        (["run", "--secure", "--certs", "nowhere"], "--certs"),
        (["run", "--secure", "--listen", "udp/localhost:1"], "--listen"),
        (["run", "--listen", "tls/localhost:7447"], "--listen"),
        (["run", "--secure", "--remote", "2"], "--certs"),
        (["run", "--secure", "--operate", "tls/localhost:1"], "--certs"),
        (["run", "--secure", "--certs", "nowhere", "--operate", "tls/localhost:1"], "--certs"),
        (["run", "--secure", "--certs", "nowhere", "--operate", "tcp/localhost:1"], "--operate"),
        (["run", "--operate", "tls/localhost:1"], "--operate"),
        (["run", "--secure", "--fault", "link u001>u002 range 30 @5"], "--secure"),
        (["join", "tls/localhost:7447"], "address"),
        (["join", "tcp/localhost:7447", "--certs", "nowhere"], "address"),
        (["join", "tls/localhost:7447", "--certs", "nowhere"], "--certs"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], field: str, tmp_path: Path) -> None:
    """The line has the field, the value and the allowed values; the status is 2."""
    command = [sys.executable, "-m", "processes.cli.main", *arguments]
    said = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert said.returncode == 2
    assert said.stderr.startswith(f"error: {field} = ")
    assert said.stderr.count("\n") == 1


def test_rules_let_a_uav_say_only_what_is_its_own() -> None:
    """No rule of one UAV names another; none lets a UAV hear the truth or all commands."""
    rules = {rule["id"]: rule for rule in access_control("m", UAVS)["rules"]}
    own = [rule for name, rule in rules.items() if name.startswith("u001 ")]
    assert {key for rule in own for key in rule["key_exprs"] if "u002" in key} == set()
    assert rules["u001 says"]["key_exprs"] == [
        "swarm/m/uav/u001/fix",
        "swarm/m/uav/u001/truth",
        "swarm/m/head/u001/command/*",
        "swarm/m/head/u001/report",
        "swarm/m/event/u001",
    ]
    assert rules["u001 lives"]["key_exprs"] == ["swarm/m/alive/u001/*"]
    heard = [key for name in ("uavs hears", "u001 hears") for key in rules[name]["key_exprs"]]
    assert heard[-2:] == ["swarm/m/head/*/command/u001", "swarm/m/goal/*/to/u001"]
    assert not [key for key in heard if "truth" in key or "**" in key]


def test_roles_may_this_and_nothing_else() -> None:
    """The table has every rule by its words; a permission with several rules has the same keys in each."""
    rules = {rule["id"]: rule for rule in access_control("m", UAVS)["rules"]}
    for name, rule in rules.items():
        assert [f"{flow} {message}" for flow in rule["flows"] for message in rule["messages"]] == [
            FLOWS[name.partition(" ")[2]]
        ]
    may = {name: " ".join(key.removeprefix("swarm/") for key in rule["key_exprs"]) for name, rule in rules.items()}
    for name, keys in may.items():
        who, _, verb = name.partition(" ")
        assert keys == may[f"{who} {SAME.get(verb, verb)}"]
    of_roles = {name for name in may if name.partition(" ")[0] in CERTIFIED}
    assert {name: may[name] for name in of_roles if name.partition(" ")[2] not in SAME} == ROLES_MAY


def test_the_recorder_alone_asks_again_and_each_answers_for_itself() -> None:
    """Each publisher has its own part in the key of retransmission."""
    again = [rule for rule in access_control("m", UAVS)["rules"] if "swarm/m/again/" in str(rule["key_exprs"])]
    assert {rule["id"] for rule in again if rule["messages"] == ["query"] and rule["flows"] == ["ingress"]} == {
        "recorder asks"
    }
    answering = {rule["id"]: rule["key_exprs"] for rule in again if rule["id"].endswith("offers answers")}
    keys = {name: [key for key in answering[f"{name} offers answers"] if "/again/" in key] for name in ANSWERING}
    assert keys == {name: [f"swarm/m/again/{name}/*"] for name in ANSWERING}
    assert len(answering) == len(ANSWERING)


def test_whoever_is_not_in_the_roster_may_nothing() -> None:
    """The default denies everything, and every rule has an owner."""
    access = access_control("m", UAVS)
    assert (access["enabled"], access["default_permission"]) == (True, "deny")
    named = {name for subject in access["subjects"] for name in subject["cert_common_names"]}
    assert named == {*UAVS, *CERTIFIED} - {"router"}
    used = {rule for policy in access["policies"] for rule in policy["rules"]}
    assert used == {rule["id"] for rule in access["rules"]}
    assert {rule["permission"] for rule in access["rules"]} == {"allow"}


def test_no_uav_may_stand_for_a_joiner() -> None:
    """No UAV may hold a joiner's token or claim ids."""
    rules = access_control("m", UAVS)["rules"]
    others = [key for rule in rules if rule["id"].startswith("u") for key in rule["key_exprs"]]
    assert not [key for key in others if "claims" in key or "alive/join" in key]


def test_addresses_of_a_secured_bus() -> None:
    """Addresses of a secured bus have another protocol."""
    assert parse_endpoint("--listen", "tls/[::1]:7447", "tls") == ("::1", 7447)
    with pytest.raises(InputError, match="tls/HOST:PORT"):
        check_endpoint("tcp/localhost:7447", "tls")
