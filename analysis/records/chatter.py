"""Did the cut chatter? Told from its record alone, by a line that the cut feeds.

What repeats with the spindle is taken out of the last revolutions of the cut. A line that is left is chatter where it

- lasts or grows: what dies away from part to part of the cut was the entry's;
- did not stand there before the entry (hum, another machine). Where no idling was recorded, a line on a multiple of the mains,
  as nearly as its place is known, is the cut's only with side bands at the tooth passing;
- is loud against the feed: the motion changes from tooth to tooth by so much that teeth leave the work, or nearly. A line with
  such side bands may be fainter. Where no channel tells metres, or no feed is known, loud is against the tooth passing. The
  sensor may sit where what chatters hardly moves: so a line with side bands counts, too, that is loud against the orders, or
  sharp.

What repeats with the spindle, but not with the teeth, is runout, a flip of an even number of teeth, or chatter that has
locked to the spindle. It is runout where it is small, or made of those orders alone that a cutter beside its axis makes, or
stood right behind the entry; chatter where it was not there behind the entry and grew, and where teeth leave the work; else the
verdict stays open.

The kind is told by how the motion grew while it was small, else by the place of its line. Near to an odd half of the tooth
passing a large motion may be either: then no kind is told.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from testbed.analysis.records.cut_end import BEFORE, STANDS, SURE_SIDES, CutEnd, Line
from testbed.analysis.records.growth import growth, is_flip
from testbed.analysis.records.once_a_turn import ECCENTRIC, Pattern, limits, pattern_of
from testbed.analysis.records.orders import PADDED, turns_of
from testbed.analysis.records.passing_speed import cut_speeds
from testbed.analysis.records.segments import Segment, revolution_period
from testbed.readers.tachometer import speed as marks_speed
from testbed.recording import Recording

Verdict = Literal["chatter", "none", "unknown"]
Kind = Literal["neimark_sacker", "flip", "flip_or_runout"]
FEWEST_TURNS, FEWEST_TEETH = 8, 16  # of the cut that are needed
SHORTEST_END, LONGEST_END = 12, 64  # revolutions of its end that are looked at, half of the cut otherwise
FEWEST_SIDES = 2  # side bands that the cut's own line has at the least
DYING, DYING_A_TOOTH = 0.5, 0.98  # of a line, from one half of the end to the other, and a tooth: a transient
GROWS, GROWS_ABOVE, FAINT = 1.3, 10.0, 0.1  # the same for one that grows, how far it must stand out, how loud at the least
LOUD = 0.3  # of the feed, in motion from tooth to tooth; of the tooth passing, in a force: a line between the orders
LOUD_FED = 0.1  # the same for a line with side bands, off the mains
CLEAR = 0.05  # of the loudest order, of a line whose side bands make it the cut's own for sure; with fewer LOUD
SHARP = 30.0  # times its surroundings: such a line, however faint, is no swing that noise keeps up
LASTS = 0.97  # of such a line, from one half of the end to the other
LOUD_UNMEASURED = 1.0  # of the loudest order, in a motion that cannot be measured against the feed; doubted from LOUD on
RAISED = 4.0  # times its median: the spectrum's floor where a motion has no lines,
LOUD_IRREGULAR, LEAST_IRREGULAR, MOST_IRREGULAR = 0.5, 0.05, 2.0  # as loud as a line; of what repeats in the channel the least
# that counts where it is integrated, and what is chatter unless it is faint against the feed
GREW = 0.3  # in the measure of each channel: what repeats with the spindle only, was not there behind the entry, and is none
# of a cutter beside its axis, whose motion near a resonance grows, too
REGULAR = 0.7  # of what does not repeat, that is made by a line which tells the kind
NEAR_HALF = 0.1  # of the tooth passing from an odd half of it, within which a large motion tells no kind
LEAVES = 1.0  # of the feed, in motion from tooth to tooth: teeth leave the work
HANN_NOISE = 1.5  # bins, that noise counts for under a Hann window
_MOTION = {("displacement", "m"): 0, ("velocity", "m/s"): 1, ("acceleration", "m/s^2"): 2}
_QUANTITIES = ("displacement", "velocity", "acceleration", "force")


@dataclass(frozen=True)
class Chatter:
    """The answer for a cut: frequency (Hz) of its strongest line, ratio of that to the line at tooth passing, the channel, and
    for `none` and `unknown` the reason in words. kind: None where there is no chatter, or no line in it."""

    verdict: Verdict
    reason: str
    kind: Kind | None = None
    frequency: float | None = None
    ratio: float | None = None
    channel: str | None = None

    def as_json(self) -> dict[str, Any]:
        """SI values, for `--json`."""
        return {"verdict": self.verdict, "kind": self.kind, "frequency": self.frequency, "ratio": self.ratio,
                "channel": self.channel, "reason": self.reason}  # fmt: skip


def judge_cut(recording: Recording, segments: Sequence[Segment]) -> Chatter:
    """Whether a recorded cut chattered, by its `segments`; at the tachometer's speed, else at that which its lines show.

    A cut chatters where one of its channels of motion or force shows it: the others may lie where what chatters does not move.
    Of those that answer alike that one is told in which the cut stands out most, first among those where a line with side bands
    is chatter.
    """
    answers = []
    for name in recording.channels:
        quantity = name.removesuffix("_x").removesuffix("_y").removesuffix("_z")
        if quantity in _QUANTITIES:
            answers.append(_of_channel(recording, segments, name, quantity))
    if not answers:
        return Chatter("unknown", "no channel of motion or force")
    return max(answers, key=lambda one: (one[1].verdict == "chatter", *one[0]))[1]


def _of_channel(recording: Recording, segments: Sequence[Segment], name: str, quantity: str
                ) -> tuple[tuple[bool, float], Chatter]:  # fmt: skip
    """((whether a line with side bands is chatter, how far the cut stands out), the answer) of one channel."""
    flutes, turn = int(recording.conditions.get("flutes") or 1), revolution_period(recording)
    parts = [part for part in segments if part.kind in ("entry", "steady")]
    if not turn:
        return (False, 0.0), Chatter("unknown", "no tachometer and no spindle speed", channel=name)
    if not parts:
        return (False, 0.0), Chatter("unknown", "no cut is found in the record", channel=name)
    inside = (recording.time >= parts[0].start) & (recording.time < parts[-1].stop)
    speeds, sure = _speeds(recording, inside, name, flutes)
    if not speeds:
        return (False, 0.0), Chatter("unknown", "the cut is too short", channel=name)
    best = None
    for speed in speeds:
        end = _end_of(recording, inside, speed, sure, name, quantity)
        if end is None:
            return (False, 0.0), Chatter("unknown", "the cut is too short", channel=name)
        lines = end.lines()
        stands = max(float(end.amplitudes[1:].max() / np.median(end.spectrum[1])), *(one.stands for one in lines), 0.0)
        answer = _by_growth(end, lines, _answer(end, lines))
        own = any(line.sides >= FEWEST_SIDES and line.order / end.turns.period == answer.frequency for line in lines)
        rank = answer.verdict == "chatter" and own, stands
        found = rank, _told(replace(answer, channel=name), "flutes" in recording.conditions)
        if best is None or (found[1].verdict == "chatter" and best[1].verdict != "chatter"):
            best = found
    assert best is not None
    return best


def _told(found: Chatter, flutes: bool) -> Chatter:
    """The answer, with what it is worth where the number of flutes is not given."""
    if flutes:
        return found
    reason = "the number of flutes is not given, so no tooth passing was looked for"
    return replace(found, ratio=None, reason=f"{found.reason}; {reason}" if found.reason else reason)


def _speeds(recording: Recording, inside: np.ndarray, name: str, flutes: int) -> tuple[tuple[float, ...], bool]:
    """Spindle speeds (rad/s) to judge at, and whether the first is sure; none where nothing tells any."""
    speed, stated = marks_speed(recording.marks), recording.conditions.get("spindle_speed")
    if speed is not None:
        return (speed,), True
    if not stated or np.count_nonzero(inside) * stated < 2.0 * math.pi * FEWEST_TURNS * recording.sampling_rate:
        return (), False
    values, first = np.asarray(recording.channels[name], dtype=float), int(np.argmax(inside))
    return cut_speeds(values[inside], recording.sampling_rate, stated, flutes, values[:first] if first > 1 else None)


def _end_of(recording: Recording, inside: np.ndarray, speed: float, sure: bool, name: str, quantity: str) -> CutEnd | None:
    """The end of the cut in a channel, laid out at that speed; None where the cut is too short."""
    values, known = np.asarray(recording.channels[name], dtype=float), recording.conditions
    flutes = int(known.get("flutes") or 1)
    whole = turns_of(values[inside], recording.time[inside], recording.marks, 2.0 * math.pi / speed)
    if len(whole.rows) < FEWEST_TURNS or len(whole.rows) * flutes < FEWEST_TEETH:
        return None
    count = min(len(whole.rows), max(len(whole.rows) // 2, SHORTEST_END), LONGEST_END)
    feed = known.get("feed_per_tooth") or (known.get("feed_per_revolution") or 0.0) / flutes
    integrals = _MOTION.get((quantity, recording.units[name])) if feed else None
    return CutEnd(whole.last(count), whole, flutes, values[: int(np.argmax(inside))], recording.sampling_rate, integrals,
                  feed, quantity == "force", sure)  # fmt: skip


def _answer(end: CutEnd, lines: Sequence[Line]) -> Chatter:
    tooth = float(end.amplitudes[end.flutes]) if end.flutes < len(end.amplitudes) else math.nan
    hum = [line for line in lines if line.on_mains and line.sides < FEWEST_SIDES]
    least = max(DYING, DYING_A_TOOTH ** (0.5 * end.count * end.flutes))
    found: tuple[float, Chatter] | None = None
    doubt: Chatter | None = None
    for line in lines:
        loud, enough = _loudness(end, line)
        rises = line.kept > 1.0 and line.kept * max(line.kept_before, 1.0) > GROWS
        grows = rises and not end.of_an_order(line) and line.stands > GROWS_ABOVE and loud > FAINT * enough
        before = end.line_before(line)
        may_be_hum = line.on_mains and math.isnan(before)  # which sounds in the idling as in the cut
        fed = line.sides >= FEWEST_SIDES and not (may_be_hum or end.of_an_order(line) or end.unmeasured)
        dies = max(line.kept, line.kept_before) < least
        quiet = loud < (LOUD_FED if fed else LOUD) and not grows and not _clear(end, line, fed, before)
        if dies or quiet or end.folded(line) or before > BEFORE:
            continue
        here = _chatter_at(end, line.order, line.amplitude, tooth, _kind(end, line.order, end.measured and loud < LEAVES))
        if math.isnan(before) and line in hum:
            alone = replace(here, verdict="unknown", reason="it may be hum: too little was recorded before the cut")
            doubt = doubt or (alone if len(hum) == 1 else None)
        elif end.unmeasured and loud < enough and not grows:
            why = "without unit and feed it cannot be told whether it is loud"
            doubt = doubt or replace(here, verdict="unknown", reason=why)
        elif found is None or loud > found[0]:
            found = loud, here
    return _of_orders(end, tooth, doubt, found)


def _clear(end: CutEnd, line: Line, fed: bool, before: float) -> bool:
    """Whether a line is the cut's own however far the sensor is from the chip: by its side bands, or louder than all orders.

    A sharp line is, where idling shows it to be the cut's: what noise keeps swinging is broad. A swing that the entry left has
    side bands, too; it dies, however slowly.
    """
    share = line.amplitude / float(end.amplitudes[1:].max())
    lasts, sharp = max(line.kept, line.kept_before) >= LASTS, line.stands > SHARP and before <= BEFORE
    if sharp and (fed or lasts and share > LOUD_UNMEASURED):
        return True
    return fed and lasts and share > (CLEAR if line.sides >= SURE_SIDES else LOUD)


def _loudness(end: CutEnd, line: Line) -> tuple[float, float]:
    """(how loud a line is, how loud it must be to be chatter)."""
    if end.measured:
        return line.amplitude * abs(end.from_tooth_to_tooth(np.array([line.order]))[0]), LOUD
    if end.is_force:
        return line.amplitude / max(float(end.amplitudes[end.flutes :: end.flutes].max(initial=0.0)), 1e-300), LOUD
    return line.amplitude / float(end.amplitudes[1:].max()), LOUD_UNMEASURED


def _kind(end: CutEnd, order: float, small: bool) -> Kind | None:
    """A flip's line is at an odd half of the tooth passing; None where it lies near and is not small: either may lead there."""
    halves = order / end.flutes - 0.5
    away = abs(halves - round(halves))
    if away * end.flutes < 0.75 / end.count:
        return "flip"
    return None if away < NEAR_HALF and not small or end.family(order) < REGULAR else "neimark_sacker"


def _by_growth(end: CutEnd, lines: Sequence[Line], found: Chatter) -> Chatter:
    """The answer with what the growth shows, where it was recorded: the kind, and, behind an entry, that it is chatter."""
    multiplier = growth(end.whole, end.flutes)
    if multiplier is None:
        return found
    kind: Kind = "flip" if is_flip(multiplier) else "neimark_sacker"
    own = [line for line in lines if not line.on_mains and end.line_before(line) <= BEFORE
           and line.kept > DYING and not end.folded(line)]  # fmt: skip
    if found.verdict == "chatter" or not own:
        return replace(found, kind=kind) if found.verdict == "chatter" else found
    tooth = float(end.amplitudes[end.flutes]) if end.flutes < len(end.amplitudes) else math.nan
    return _chatter_at(end, own[0].order, own[0].amplitude, tooth, kind)


def _chatter_at(end: CutEnd, order: float, amplitude: float, tooth: float, kind: Kind | None) -> Chatter:
    return Chatter("chatter", "", kind, order / end.turns.period, amplitude / tooth if tooth > 0.0 else None)


def _of_orders(end: CutEnd, tooth: float, doubt: Chatter | None, found: tuple[float, Chatter] | None) -> Chatter:
    """The answer with what repeats with the spindle, but not with the teeth. found: (loudness, answer) of a line between."""
    seen = pattern_of(end)
    loud, doubted = limits(end, seen)
    top = int(np.argmax(np.abs(seen.half if seen.flips else seen.others)))
    amplitude = float(np.abs(seen.others[top])) * 2.0 / len(end.turns.pattern)
    of_orders = _chatter_at(end, top, amplitude, tooth, _locked_kind(end, seen))
    if found is not None and (seen.size < loud or found[0] > seen.size or not seen.flips):
        return found[1]
    if seen.size > loud or seen.grew and seen.size > GREW and (seen.flips or seen.rest > ECCENTRIC):
        return of_orders
    irregular = _irregular(end, tooth)
    if irregular is not None:
        return irregular
    if seen.most > doubted and (not seen.at_once or seen.rest > ECCENTRIC or _teeth_leave(end, seen)):
        return replace(of_orders, verdict="unknown", kind="flip_or_runout", reason="it may be runout")
    return _nothing(end, doubt)


def _locked_kind(end: CutEnd, seen: Pattern) -> Kind | None:
    """The kind of chatter that repeats with the spindle: a flip by its orders, unless runout may have stood there first."""
    if not seen.flips:
        return None
    return "flip" if seen.grew or end.measured and seen.rest > ECCENTRIC else "flip_or_runout"


def _teeth_leave(end: CutEnd, seen: Pattern) -> bool:
    """Whether a force of few teeth changes by as much as they make: runout seldom does so."""
    return end.is_force and end.flutes == 2 and seen.most > 1.0


def _nothing(end: CutEnd, doubt: Chatter | None) -> Chatter:
    """The answer where nothing is chatter for sure."""
    if doubt is not None:
        return doubt
    if not end.sure:
        return Chatter("unknown", "the spindle speed is not known well enough")
    if float(end.amplitudes[1:].max()) < STANDS * np.median(end.spectrum[1]):
        return Chatter("unknown", "the cut does not stand out of the noise")
    return Chatter("none", "every line repeats with the teeth, dies away, or is there without the cut")


def _irregular(end: CutEnd, tooth: float) -> Chatter | None:
    """Chatter without lines: the spectrum's floor itself stands far above the noise, as loud as a line must be."""
    lines, floor = end.spectrum
    orders = np.arange(len(lines)) / (end.count * PADDED)
    hum = np.array([end.on_mains(float(order), 0.4) for order in orders]) & math.isnan(end.before(1.0))
    raised = (floor > RAISED * np.maximum(np.median(floor), end.still_floor(orders))) & (orders > 2.0 / end.count) & ~hum
    power = raised * floor**2 / (math.log(2.0) * HANN_NOISE * PADDED)
    loud = of_pattern = math.sqrt(float(np.sum(power))) / max(float(np.linalg.norm(end.amplitudes[1:])), 1e-300)
    if end.measured:
        loud = math.sqrt(float(np.sum(power * np.abs(end.from_tooth_to_tooth(orders)) ** 2)))
    faint = bool(end.integrals) and (math.isnan(end.before(1.0)) or of_pattern < LEAST_IRREGULAR)  # hum grows when integrated
    if loud < (LOUD_IRREGULAR if of_pattern < MOST_IRREGULAR else LOUD_FED) or faint or not (end.measured or end.is_force):
        return None
    top = int(np.argmax(np.abs(lines) * raised))
    return _chatter_at(end, float(orders[top]), float(np.abs(lines[top])), tooth, None)
