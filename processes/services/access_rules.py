"""Access rules of a secured bus, which the router applies by the name in a process's certificate.

The router denies everything that no rule here allows.

==========  ================================================  ==================================================
Process     May publish                                       May receive
==========  ================================================  ==================================================
UAV         on its own keys only, also as head, since every   all fixes and reports, its own commands and
            key names its sender                              goals, the mission and the operator's events, but
                                                              never a truth
operator    the mission, its events, goals                    all fixes, reports, commands and events
recorder    its events                                        all messages
visualiser  its events, scenes                                all messages of UAVs, the mission, all events
join        nothing; it may claim ids, and its UAVs have      the operator's events
            certificates of their own
host.NAME   what its UAVs may, and claims                     what its UAVs may, and all that they say
==========  ================================================  ==================================================

Two routers apply rules where a host has one of its own. The mission's knows the host's router as `host.NAME`. The
host's knows its UAVs, its `join` and its recorder (`host.NAME`); from the mission's `router` it takes everything, since
that one has applied its own rules.

`ingress` is traffic from the named process to the router, `egress` traffic from the router to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from edc_swarm.mission.roles import GROUND, JOIN, LIVE, OPERATOR, RECORDER, ROUTER, VISUALISER
from edc_swarm.protocol.keys import ALL_ALIVE, PREFIX, Keys
from processes.bus.abort_notice import NOTICE_KEY
from processes.bus.operator_presence import GAVE_UP

ANY_MISSION = "*"
"""Wildcard for the mission's id, for a router that starts before its mission is known."""
OPERATORS_ALIVE = f"{PREFIX}/*/alive/{OPERATOR}/*"
"""Liveliness key of operators, by which a process finds the id of the mission."""

MESSAGES = (
    "put",
    "delete",
    "query",
    "reply",
    "declare_subscriber",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)
"""All kinds of messages that rules distinguish."""

Rule = dict[str, Any]


def access_control(
    mission: str, uavs: Sequence[str], hosts: Mapping[str, Sequence[str]] | None = None
) -> dict[str, Any]:
    """Return Zenoh's `access_control` for one mission, or `ANY_MISSION`, and its possible UAVs.

    `hosts`: the UAVs of each host with a router or a recorder of its own, by the name in its certificate.
    """
    keys = Keys(mission)
    linked = {name: _of_host(keys, name, said) for name, said in (hosts or {}).items()}
    return _control(keys, uavs, _of_roles(keys) | linked)


def host_access_control(name: str, uavs: Sequence[str]) -> dict[str, Any]:
    """Return Zenoh's `access_control` for the router of a host with some UAVs, whose mission it does not know yet."""
    keys = Keys(ANY_MISSION)
    own = [
        _says(name, [keys.event(RECORDER)]),
        *_hears(name, keys.said_by(uavs)),
        *_asks(name, [keys.again(uav, "*") for uav in uavs]),
    ]
    relayed = [
        {**_rule(f"{ROUTER} links", "ingress", "put", ["**"]), "flows": ["ingress", "egress"], "messages": [*MESSAGES]}
    ]
    return _control(keys, uavs, {JOIN: _of_roles(keys)[JOIN], name: own, ROUTER: relayed})


def _control(keys: Keys, uavs: Sequence[str], others: Mapping[str, list[Rule]]) -> dict[str, Any]:
    """Return the rules of UAVs, and of `others` by the name in the certificate."""
    shared = _shared_by_uavs(keys)
    rules = list(shared)
    policies = [{"subjects": list(uavs), "rules": [rule["id"] for rule in shared]}]
    for name, own in [*((uav, _of_uav(keys, uav)) for uav in uavs), *others.items()]:
        rules += own
        policies.append({"subjects": [name], "rules": [rule["id"] for rule in own]})
    names = [*uavs, *others]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name in names],
        "policies": policies,
    }


def _shared_by_uavs(keys: Keys) -> list[Rule]:
    asked = [keys.mission, keys.event(OPERATOR)]
    return [
        *_hears("uavs", [*asked, keys.all_fixes, keys.all_reports]),
        *_asks("uavs", asked),
        *_sees_the_living("uavs", keys.all_alive),
    ]


def _of_uav(keys: Keys, uav: str) -> list[Rule]:
    asked_again = _answers(uav, [keys.again(uav, "*")])
    return [
        _says(uav, _own(keys, uav)),
        *_hears(uav, _meant_for(keys, uav)),
        *asked_again,
        _lives(uav, keys),
    ]


def _of_roles(keys: Keys) -> dict[str, list[Rule]]:
    asked = [keys.mission, keys.event(OPERATOR)]
    seen = [keys.mission, f"{keys.root}/uav/**", f"{keys.root}/head/**", keys.event("*")]
    return {
        OPERATOR: [
            _says(OPERATOR, [*asked, keys.goal(OPERATOR, "*")]),
            *_hears(OPERATOR, [keys.all_fixes, keys.all_reports, keys.command("*", "*"), keys.event("*")]),
            *_answers(OPERATOR, [*asked, keys.claims, keys.orders("*"), keys.again(OPERATOR, "*")]),
            *_asks(OPERATOR, [keys.mission, keys.orders(RECORDER)]),
            _lives(OPERATOR, keys),
            _rule(f"{OPERATOR} gives up", "ingress", "liveliness_token", [f"{NOTICE_KEY}/*"]),
            *_sees_the_living(OPERATOR, keys.all_alive),
            _rule(f"{OPERATOR} looks for missions", "ingress", "liveliness_query", [ALL_ALIVE]),
        ],
        RECORDER: [
            _says(RECORDER, [keys.event(RECORDER)]),
            *_hears(RECORDER, [keys.everything]),
            *_asks(RECORDER, [keys.orders(RECORDER), keys.again("*", "*")]),
            *_answers(RECORDER, [keys.mission, keys.orders(RECORDER)]),
            _lives(RECORDER, keys),
            *_sees_the_living(RECORDER, OPERATORS_ALIVE, GAVE_UP),
        ],
        VISUALISER: [
            _says(VISUALISER, [keys.event(VISUALISER), f"{keys.root}/viz/**"]),
            *_hears(VISUALISER, seen),
            *_asks(VISUALISER, [*asked, keys.orders(VISUALISER), keys.orders(LIVE)]),
            *_answers(VISUALISER, [keys.again(VISUALISER, "*")]),
            _lives(VISUALISER, keys),
            *_sees_the_living(VISUALISER, OPERATORS_ALIVE, GAVE_UP),
        ],
        GROUND: [
            _says(GROUND, [keys.event(GROUND)]),
            *_hears(GROUND, [keys.mission, keys.all_fixes, keys.event("*")]),
            *_asks(GROUND, [keys.mission]),
            *_answers(GROUND, [keys.again(GROUND, "*")]),
            _lives(GROUND, keys),
        ],
        JOIN: [
            *_hears(JOIN, [keys.event(OPERATOR)]),
            *_asks(JOIN, [keys.claims]),
            _lives(JOIN, keys),
            *_sees_the_living(JOIN, OPERATORS_ALIVE, GAVE_UP),
        ],
    }


def _of_host(keys: Keys, name: str, uavs: Sequence[str]) -> list[Rule]:
    """Return the rules of a host's router, which hands over what its UAVs and its joiner say, and of its recorder."""
    said = [key for uav in uavs for key in _own(keys, uav)]
    heard = [keys.all_fixes, keys.all_reports, *(key for uav in uavs for key in _meant_for(keys, uav))]
    again = [keys.again(uav, "*") for uav in uavs]
    interests = ("declare_subscriber", "declare_queryable", "declare_liveliness_subscriber")
    return [
        _says(name, said),
        *_hears(name, [*heard, *keys.said_by(uavs)]),
        *_asks(name, [keys.mission, keys.event(OPERATOR), keys.claims, *again]),
        *_answers(name, again),
        _rule(f"{name} lives", "ingress", "liveliness_token", [keys.alive(who, "*") for who in (*uavs, JOIN)]),
        *_sees_the_living(name, keys.all_alive, OPERATORS_ALIVE, GAVE_UP),
        {**_rule(f"{name} is subscribed to", "egress", "put", [f"{PREFIX}/**"]), "messages": [*interests]},
    ]


def _own(keys: Keys, uav: str) -> list[str]:
    return [keys.fix(uav), keys.truth(uav), keys.command(uav, "*"), keys.report(uav), keys.event(uav)]


def _meant_for(keys: Keys, uav: str) -> list[str]:
    return [keys.commands_to(uav), keys.goal("*", uav)]


def _says(name: str, keys: list[str]) -> Rule:
    return _rule(f"{name} says", "ingress", "put", keys)


def _hears(name: str, keys: list[str]) -> list[Rule]:
    return [
        _rule(f"{name} subscribes", "ingress", "declare_subscriber", keys),
        _rule(f"{name} hears", "egress", "put", keys),
    ]


def _asks(name: str, keys: list[str]) -> list[Rule]:
    return [_rule(f"{name} asks", "ingress", "query", keys), _rule(f"{name} is answered", "egress", "reply", keys)]


def _answers(name: str, keys: list[str]) -> list[Rule]:
    return [
        _rule(f"{name} offers answers", "ingress", "declare_queryable", keys),
        _rule(f"{name} is asked", "egress", "query", keys),
        _rule(f"{name} answers", "ingress", "reply", keys),
    ]


def _lives(name: str, keys: Keys) -> Rule:
    return _rule(f"{name} lives", "ingress", "liveliness_token", [keys.alive(name, "*")])


def _sees_the_living(name: str, *whom: str) -> list[Rule]:
    return [
        _rule(f"{name} watches", "ingress", "declare_liveliness_subscriber", [*whom]),
        _rule(f"{name} sees the living", "egress", "liveliness_token", [*whom]),
    ]


def _rule(name: str, flow: str, message: str, keys: list[str]) -> Rule:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": [message], "key_exprs": keys}
