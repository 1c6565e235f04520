"""Register of ids: it issues each id to one claimant."""

from __future__ import annotations

import msgspec
import pytest

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.claims import MAX_CLAIMANTS, Claims, IdClaim, claimant_of, instance_name

ANNE, BERT, CARL = (letter * 16 for letter in "abc")


@pytest.fixture
def book() -> Claims:
    """Three ids, and two claimants that are there."""
    book = Claims(["u1", "u2", "u3"])
    for claimant in (ANNE, BERT):
        book.see_claimant(claimant, True)
    return book


def claim(claimant: str, uavs: int = 1) -> IdClaim:
    """A claim."""
    return IdClaim(claimant=claimant, uavs=uavs)


def test_a_claim_of_a_cluster_names_its_uavs() -> None:
    """Of those that the claimant can fly; a cluster without one has no ids, which is not the same as all ids."""
    places = [("a", 0.0), ("b", 20.0), ("b", 40.0)]
    roster = [
        RosterEntry(uav=f"u{k}", cluster=cluster, start_x_m=x_m, start_y_m=0.0, target_x_m=x_m, target_y_m=0.0)
        for k, (cluster, x_m) in enumerate(places)
    ]
    mission = Mission(roster=roster, uavs=3)

    def named(cluster: str, *among: str) -> list[str] | None:
        found = IdClaim(claimant=ANNE, uavs=1, cluster=cluster, among=list(among)).by_name(mission)
        return found.among if found is not None else None

    assert [named("b"), named("b", "u0", "u2"), named("")] == [["u1", "u2"], ["u2"], []]
    assert [named("b", "u0"), named("c")] == [None, None]


def test_ids_are_issued_in_order_all_or_none(book: Claims) -> None:
    """A claimant that asks for more ids than are free gets none."""
    assert book.issue(claim(ANNE, 2)) == ["u1", "u2"]
    assert book.issue(claim(BERT, 2)) == []
    assert book.issue(claim(BERT)) == ["u3"]
    assert book.free() == []


def test_an_id_is_issued_to_who_can_fly_it(book: Claims) -> None:
    """A claimant that names the ids that it can fly gets only those; ids that are not remote do not count."""
    able = IdClaim(claimant=ANNE, uavs=2, among=["u0", "u3", "u2"])
    assert book.free(["u0", "u1"]) == ["u1"]
    assert book.issue(IdClaim(claimant=BERT, uavs=2, among=["u0", "u1"])) == []
    assert book.issue(able) == ["u2", "u3"]
    assert book.issue(claim(BERT)) == ["u1"]


def test_a_repeated_claim_has_the_same_answer(book: Claims) -> None:
    """The answer may have been lost, or the claimant started again, also when the mission has begun."""
    assert book.issue(claim(ANNE)) == book.issue(claim(ANNE)) == ["u1"]
    book.see_claimant(ANNE, False)
    book.begin()
    assert book.issue(claim(ANNE)) == ["u1"]


def test_before_the_mission_a_claimant_that_has_gone_leaves_its_ids(book: Claims) -> None:
    """It has promised nothing yet."""
    book.issue(claim(ANNE, 3))
    assert book.issue(claim(BERT)) == []
    book.see_claimant(ANNE, False)
    assert book.held == set()
    assert book.issue(claim(BERT, 2)) == ["u1", "u2"]
    assert book.held == {"u1", "u2"}
    assert book.issue(claim(ANNE)) == ["u3"]


def test_ids_of_claimants_that_have_gone_are_issued_last(book: Claims) -> None:
    """All seem to have gone while the router is started again."""
    book.issue(claim(ANNE))
    book.see_claimant(ANNE, False)
    assert book.issue(claim(BERT)) == ["u2"]
    assert book.issue(claim(ANNE)) == ["u1"]


def test_a_claim_that_overtakes_the_token_counts() -> None:
    """A claimant keeps its id before its token arrives."""
    again = Claims(["u1"])
    assert again.issue(claim(ANNE)) == ["u1"]
    assert again.issue(claim(BERT)) == []


def test_once_begun_nothing_is_issued_to_anybody_else(book: Claims) -> None:
    """Its promises are in the folder of the claimant that has gone."""
    book.issue(claim(ANNE, 2))
    book.begin()
    book.see_claimant(ANNE, False)
    assert book.issue(claim(BERT)) == []
    assert book.claimants(["u0", "u1", "u2", "u3"]) == ("", ANNE, ANNE, "")


def test_the_book_is_written_again_from_tokens() -> None:
    """In whatever order they come, and the first holder stays."""
    again = Claims(["u1", "u2", "u3"])
    again.see_uav("u2", instance_name("12-00ff00ff", BERT))
    again.see_claimant(BERT, True)
    again.see_uav("u2", instance_name("13-00ff00ff", ANNE))
    again.see_uav("u9", instance_name("14-00ff00ff", ANNE))
    again.see_uav("u1", "15-00ff00ff")
    assert again.held_by(BERT) == ["u2"]
    again.see_claimant(CARL, True)
    assert again.issue(claim(CARL, 2)) == ["u1", "u3"]


def test_the_mission_message_says_who_holds_what(book: Claims) -> None:
    """An operator that takes over has the whole book at once."""
    book.resume({"u1": ANNE, "u2": BERT, "u3": ""})
    assert book.issue(claim(BERT)) == ["u2"]
    assert book.issue(claim(CARL)) == []


def test_names_of_instances() -> None:
    """The claimant is the end of the name, if there is one."""
    assert claimant_of(instance_name("12-00ff00ff", ANNE)) == ANNE
    assert instance_name("12-00ff00ff", "") == "12-00ff00ff"
    assert claimant_of("12-00ff00ff") == ""


def test_a_mission_without_remote_uavs_names_no_claimants() -> None:
    """Its message stays as short as it was."""
    assert Claims([]).claimants(["u1", "u2"]) == ()


def test_a_flood_of_claimants_fills_no_memory() -> None:
    """The register remembers a limited number of claimants; a forgotten one only seems to be gone."""
    book, names = Claims(["u1", "u2"]), [f"{number:016x}" for number in range(MAX_CLAIMANTS + 5)]
    for name in names:
        book.see_claimant(name, True)
    for uav, name in (("u1", names[MAX_CLAIMANTS - 1]), ("u2", names[MAX_CLAIMANTS])):
        book.see_uav(uav, instance_name("12-00ff00ff", name))
    assert book.held == {"u1"}
    book.see_claimant(names[0], False)
    book.see_claimant(names[MAX_CLAIMANTS], True)
    assert book.held == {"u1", "u2"}, "one that leaves makes room"


@pytest.mark.parametrize("wrong", [{"claimant": "a" * 15}, {"claimant": ANNE + "\n"}, {"uavs": 0}, {"uavs": 10_001}])
def test_what_is_no_claim_is_refused(wrong: dict[str, object]) -> None:
    """Sixteen hexadecimal digits, and as many UAVs as a mission can have."""
    right = {"claimant": ANNE, "uavs": 10_000}
    assert msgspec.convert(right, IdClaim).uavs == 10_000
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({**right, **wrong}, IdClaim)
