"""The own failsafe of an autopilot: the parameters that say what it does without set-points and without its process.

They are read, told and judged before the vehicle is armed; nothing writes them. Values and meanings are those of
ArduCopter 4.6 (4.7 calls SYSID_MYGCS MAV_GCS_SYSID) and PX4 1.15.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from edc_swarm.autopilot.telemetry import ARDUPILOT, PX4, Telemetry
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.failsafe import failsafe_of

OWN_SYSTEM = 255
"""MAVLink system of UAV processes: a ground station, which ArduPilot obeys and watches by default."""
WANTED: Mapping[int, tuple[tuple[str, ...], ...]] = {
    ARDUPILOT: (("GUID_TIMEOUT",), ("FS_GCS_ENABLE",), ("FS_GCS_TIMEOUT",), ("SYSID_MYGCS", "MAV_GCS_SYSID")),
    PX4: (("COM_OF_LOSS_T",), ("COM_OBL_RC_ACT",)),
}
"""Parameters that are asked for, by firmware; of several names for one the autopilot knows one."""
LANDS, STOPS, RETURNS = "lands", "hovers", "returns home"
_ARDUPILOT_DOES = {0: STOPS, 1: RETURNS, 2: RETURNS, 3: RETURNS, 4: RETURNS, 5: LANDS, 6: RETURNS, 7: STOPS}
"""FS_GCS_ENABLE: 7 is BRAKE, which hovers; 4 is SmartRTL, or land."""
_PX4_DOES = {3: RETURNS, 4: LANDS, 5: STOPS}
"""COM_OBL_RC_ACT."""
_PX4_OTHER = {0: "Position", 1: "Altitude", 2: "Stabilized", 6: "Terminate", 7: "Disarm"}


def lacking(seen: Telemetry) -> list[str]:
    """Return the parameters that the autopilot has not told."""
    return [names[0] for names in WANTED.get(seen.firmware, ()) if not any(name in seen.parameters for name in names)]


def asked_names(seen: Telemetry) -> list[str]:
    """Return all names to ask for."""
    missing = set(lacking(seen))
    return [name for names in WANTED.get(seen.firmware, ()) if names[0] in missing for name in names]


def told(seen: Telemetry) -> str:
    """Return what the autopilot does by itself, in words; "" if it has not told."""
    values = seen.parameters
    if lacking(seen) or seen.firmware not in WANTED:
        return ""
    if seen.firmware == PX4:
        return f"without set-points it {_action(seen)} after {values['COM_OF_LOSS_T']:g} s"
    after_s = values["FS_GCS_TIMEOUT"]
    return (
        f"without set-points it stops after {values['GUID_TIMEOUT']:g} s, without its process it {_action(seen)}"
        + f" after {after_s:g} s" * bool(values["FS_GCS_ENABLE"])
    )


def warnings(seen: Telemetry, mission: Mission) -> Iterator[str]:
    """Yield what is wrong with that for a mission, with the parameter that changes it."""
    if seen.firmware not in WANTED:
        return
    if names := lacking(seen):
        yield f"it does not tell {', '.join(names)}: what it does without its process is unknown"
        return
    values = seen.parameters
    px4 = seen.firmware == PX4
    timeout, action = ("COM_OF_LOSS_T", "COM_OBL_RC_ACT") if px4 else ("GUID_TIMEOUT", "FS_GCS_ENABLE")
    does, number = _action(seen), values[action]
    if values[timeout] > mission.dt_s:
        yield (
            f"without set-points it flies on for {values[timeout]:g} s with its last velocity: set {timeout} to the"
            f" length of a slot, {mission.dt_s:g}"
        )
    failsafe, lands = failsafe_of(mission), f"set {action} to {4 if px4 else 5} (land)"
    if does == RETURNS:
        yield f"without its process it returns home across the others' ways, which nobody plans: {lands}"
    elif does not in {LANDS, STOPS}:
        yield f"without its process it {does}: {lands}"
    elif failsafe is not None and does == STOPS:
        yield f'without its process it hovers, where the mission takes it for landed: {lands}, or failsafe = "hold"'
    lost = "COM_OF_LOSS_T" if px4 else "FS_GCS_TIMEOUT"
    if failsafe is not None and does == LANDS and values[lost] > mission.land_after_s:
        yield f"it lands {values[lost]:g} s after its process died: set {lost} to at most {mission.land_after_s:g}"
    watched = values.get("SYSID_MYGCS", values.get("MAV_GCS_SYSID", OWN_SYSTEM))
    if not px4 and number and watched != OWN_SYSTEM:
        yield (
            f"its failsafe watches the ground station {watched:g}, not its process: set SYSID_MYGCS"
            f" (MAV_GCS_SYSID) to {OWN_SYSTEM}"
        )


def _action(seen: Telemetry) -> str:
    """Return what the autopilot does by its failsafe, in words."""
    if seen.firmware != PX4:
        number = round(seen.parameters["FS_GCS_ENABLE"])
        return _ARDUPILOT_DOES.get(number, f"does what FS_GCS_ENABLE {number} says")
    number = round(seen.parameters["COM_OBL_RC_ACT"])
    mode = _PX4_OTHER.get(number, str(number))
    return _PX4_DOES.get(number, f"goes to {mode} (COM_OBL_RC_ACT {number})")
