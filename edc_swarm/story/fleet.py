"""The UAVs of a story: each from slot to slot, and what each slot shows of it."""

from __future__ import annotations

import msgspec
from msgspec import UNSET

from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.messages import Event, Fix, Report
from edc_swarm.story.happening import Kind, Level
from edc_swarm.story.heard import Heard
from edc_swarm.story.log import Log
from edc_swarm.story.places import Place, Why, hulls_of, why_no_step
from edc_swarm.story.uav import CUT_OFF_SLOTS, HOLD_SLOTS, LONG_HOLD_SLOTS, Ended, Uav, why_not_flown

LOW_SHARE = 0.2
"""Share of the first charge below which a battery is low."""


class Fleet:
    """The UAVs of one mission.

    Attributes
    ----------
    uavs
        What is known of each, by id in roster order.
    late
        UAVs that began the slot that was told last too late.
    """

    def __init__(self, mission: Mission, log: Log, *, from_first: bool = True) -> None:
        self._mission = mission
        self._log = log
        self._steps_m = dict(zip((entry.uav for entry in mission.roster), mission.steps_m, strict=True))
        self._r_m = {entry.uav: entry.r_m for entry in mission.roster}
        self._local = mission.control == "local"
        self._from_first = from_first
        self._flown = not from_first
        self.uavs = {entry.uav: Uav(entry) for entry in mission.roster}
        self.late: list[str] = []

    def stop(self, name: str, ended: Ended) -> None:
        """Note what stopped a UAV; the happening follows once it is silent, and has no earlier time."""
        if name in self.uavs:
            self.uavs[name].ended = ended

    def land(self, name: str, how: str) -> None:
        """Tell once that a UAV has landed."""
        uav = self.uavs.get(name)
        if uav is not None and not uav.landed:
            uav.landed = True
            self._end_span(uav)
            self._log.tell("landed", [name], how, level="warning")

    def close(self, event: Event) -> None:
        """Compare the numbers of a UAV's last word with the fixes that were heard of it."""
        try:
            last = msgspec.json.decode(event.detail, type=dict[str, int])
        except msgspec.MsgspecError:
            return
        uav = self.uavs[event.source]
        said = next((seq for key, seq in last.items() if key.endswith("/fix")), -1)
        if said + 1 > uav.expected.get(event.instance, 0) and uav.is_gone:
            self._become_unknown(uav)

    def take(self, heard: Heard, before: Report | None) -> None:
        """Tell what a slot shows of each UAV; `before` is the plan that its commands come from."""
        self.late = []
        if not self._flown and (up := [name for name, fix in heard.fixes.items() if fix.executing]):
            self._flown = True
            self._log.tell("take-off", [name for name in self.uavs if name in up], "first commands flown")
        for name, uav in self.uavs.items():
            fix = heard.fixes.get(name)
            if fix is None:
                self._miss(uav)
            else:
                self._hear(uav, fix, heard, before)
            if uav.landed:
                uav.state = "landed"

    # --- one UAV in one slot --------------------------------------------------------------------

    def _miss(self, uav: Uav) -> None:
        """Tell of a slot without a fix; that a UAV which has landed says no more is no news."""
        uav.held_slots = 0
        if uav.landed:
            return
        if not uav.is_silent():
            return
        ended = uav.ended or Ended("silent", "no fix of it" if uav.fix else "no fix of it so far")
        begun = ended.begun(self._log.slot - uav.silent_slots + 1)
        self._begin_span(uav, ended.kind, Why("", ended.how), begun, ended.at_s)
        self._warn(uav)
        uav.state = {"dead": "dead", "frozen": "frozen"}.get(ended.kind, "silent")  # type: ignore[assignment]

    def _hear(self, uav: Uav, fix: Fix, heard: Heard, before: Report | None) -> None:
        known = uav.fix
        lacking = uav.lacked(heard.fix_seqs[uav.uav], from_first=self._from_first)
        if uav.is_gone:
            self._return(uav, fix, lacking)
        uav.silent_slots, uav.fix = 0, fix
        if known is not None:
            self._compare(uav, known, fix)
        elif fix.arrived:
            self._log.tell("arrived", [uav.uav], "at the target")
        if not uav.is_low and fix.energy_j < LOW_SHARE * uav.entry.energy_j:
            uav.is_low = True
            share = 100 * fix.energy_j / uav.entry.energy_j
            self._log.tell("battery-low", [uav.uav], f"{share:.0f} % of its charge left", level="warning")
        self._settle(uav, fix, heard, before)

    def _return(self, uav: Uav, fix: Fix, lacking: int) -> None:
        """Tell that a silent UAV is heard again; its silence is unknown if fixes of this process are missing."""
        if lacking:
            self._become_unknown(uav)
            self._end_span(uav)
            return
        is_new = uav.fix is None or fix.instance != uav.fix.instance
        how = "a new process" if is_new else "the same process"
        self._end_span(uav)
        uav.ended = None
        lost = "" if fix.voter else ", without its memory" if fix.stray_m is UNSET else ", as a stray"
        self._log.tell("back", [uav.uav], f"heard again: {how}{lost}")

    def _compare(self, uav: Uav, known: Fix, fix: Fix) -> None:
        if fix.course.goal > known.course.goal and fix.course.fits(uav.entry):
            x_m, y_m = fix.course.left(uav.entry)[-1]
            level: Level = "detail" if self._mission.goals == "lifelong" else "news"
            self._log.tell(
                "goal", [uav.uav], f"flies to goal {fix.course.goal} at ({x_m:.1f}, {y_m:.1f}) m", level=level
            )
        elif fix.course.leg > known.course.leg:
            self._log.tell("goal", [uav.uav], f"reached point {fix.course.leg} of its route", level="detail")
        if fix.arrived and not known.arrived:
            self._log.tell("arrived", [uav.uav], "target reached")
        if known.arrived and not fix.arrived and fix.course.goal == known.course.goal:
            self._log.tell("left-target", [uav.uav], "left its target", level="detail")
        if fix.instance == known.instance and fix.late_ticks > known.late_ticks and fix.slot == known.slot + 1:
            self.late.append(uav.uav)

    def _settle(self, uav: Uav, fix: Fix, heard: Heard, before: Report | None) -> None:
        """Decide the state of a UAV that was heard."""
        is_cut_off, is_held = uav.is_cut_off(heard.plan), uav.is_held(fix, self._mission.dt_s)
        if uav.uav in heard.command_holes and uav.span is not None and uav.span.reason == "no-command":
            uav.span.reason, uav.span.detail = "unknown", "the record lacks commands for it"
        if is_cut_off and heard.plan is not None:
            if uav.span is None or uav.span.kind != "cut-off":
                since = self._log.slot - CUT_OFF_SLOTS + 1
                how = f"no fix reaches head {heard.plan.head}"
                self._begin_span(uav, "cut-off", Why("", how), max(0, since))
                self._warn(uav)
            uav.state = "cut-off"
        elif is_cut_off:
            uav.state = "cut-off"
        elif is_held and self._flown:
            self._hold(uav, fix, heard, before)
        else:
            self._end_span(uav)
            uav.state = "arrived" if fix.arrived else "flying" if fix.executing else "holding"

    def _hold(self, uav: Uav, fix: Fix, heard: Heard, before: Report | None) -> None:
        """Tell that a UAV holds, and why; tell anew once another reason has lasted as long as a hold must."""
        why = self._why(uav, fix, heard, before)
        span = uav.span
        if span is None or span.kind != "holding":
            self._begin_span(uav, "holding", why, self._log.slot - HOLD_SLOTS + 1)
            uav.other_slots = 0
        elif (span.reason, span.by) != (why.reason, why.by):
            uav.other_slots += 1
            if uav.other_slots >= HOLD_SLOTS:
                self._begin_span(uav, "holding", why, self._log.slot - HOLD_SLOTS + 1)
                uav.other_slots = 0
        else:
            uav.other_slots = 0
            if span.level == "detail" and self._log.slot - span.slot >= LONG_HOLD_SLOTS:
                span.level = "news"
                self._log.tell_again(span)
        uav.state = "beside" if why.reason == "covered" and why.is_near else "holding"

    def _why(self, uav: Uav, fix: Fix, heard: Heard, before: Report | None) -> Why:
        if not fix.executing and self._local:
            return Why("no-step", "it had no step of its own in time")
        if not fix.executing:
            return why_not_flown(fix, heard.commands.get(uav.uav), before)
        step_m = self._steps_m[uav.uav]
        return why_no_step(uav.here_m, uav.aim_m, uav.entry.r_m, step_m, self._others(uav, before))

    def _others(self, uav: Uav, plan: Report | None) -> list[Place]:
        """Return the places of all other UAVs in the airspace: hulls of the plan, and discs."""
        hulls = hulls_of(plan, self._r_m)
        places = [hull for name, hull in hulls.items() if name != uav.uav and not self.uavs[name].landed]
        for name, other in self.uavs.items():
            if name == uav.uav or other.landed:
                continue
            stays = other.is_gone or other.state == "cut-off" or (other.fix is not None and other.fix.arrived)
            reach_m = 0.0 if stays else self._steps_m[name]
            places.append(Place(name, "disc", other.here_m, other.here_m, 0.0, other.entry.r_m, reach_m))
        return places

    # --- spans ----------------------------------------------------------------------------------

    def _begin_span(self, uav: Uav, kind: Kind, why: Why, since: int, at_s: float = 0.0) -> None:
        """Tell that something begins to last with slot `since`, but not before `at_s`, when its cause happened."""
        self._end_span(uav, since)
        level: Level = "detail" if kind == "holding" else "news"
        time_s = max(at_s, since * self._mission.dt_s)
        uav.span = self._log.tell(
            kind,
            [uav.uav],
            why.detail,
            level=level,
            slot=since,
            time_s=time_s,
            lasts=True,
            reason=why.reason,
            by=why.by,
        )

    def _warn(self, uav: Uav) -> None:
        if uav.span is not None:
            uav.span.level = "warning"

    def _end_span(self, uav: Uav, at: int | None = None) -> None:
        if uav.span is not None:
            uav.span.last_slot = max(uav.span.slot, (self._log.slot if at is None else at) - 1)
            uav.span = None

    def _become_unknown(self, uav: Uav) -> None:
        """Take back that a UAV was silent: the record lacks its fixes."""
        uav.state = "unknown"
        if uav.span is not None:
            uav.span.kind, uav.span.detail, uav.span.level = "unknown", "the record lacks its fixes", "news"
