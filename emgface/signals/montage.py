"""Channels of the study in a recording, and treatment of missing ones."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

import xarray as xr

from emgface.choices import Parameters, choice
from emgface.errors import SchemaError, listed
from emgface.muscles import CHANNELS, MUSCLES
from emgface.signals.mapping import sources_of


class MontageParameters(Parameters):
    """Treatment of muscles that were not recorded."""

    missing_side: Literal["error", "mirror", "zero", "leave_out"] = choice(
        "error",
        "Treatment of a channel that was recorded on the other side only.",
        note="'mirror' copies the signal of the other side, so that the motion is symmetric; 'zero' "
        "sets the signal to zero; 'leave_out' leaves out every muscle that is computed from it; "
        "with 'error' a strategy that needs such a muscle fails",
    )
    missing_muscle: Literal["error", "zero", "leave_out"] = choice(
        "error",
        "Treatment of a channel that was recorded on neither side.",
        note="with 'zero' a muscle that is computed from several channels is estimated from those "
        "that were recorded, for example BUC from ZYG alone; 'leave_out' leaves such a muscle out",
    )


@dataclass(frozen=True)
class Montage:
    """Treatment of each of the fourteen channels.

    Each channel belongs to one of the groups `recorded`, `mirrored`, `zero`, `left_out` and
    `unresolved` (missing, without a chosen treatment). `ignored` are further channels of the
    recording.
    """

    recorded: tuple[str, ...]
    mirrored: tuple[str, ...] = ()
    zero: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    unresolved: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()

    @property
    def estimated(self) -> tuple[str, ...]:
        """Muscles whose activation is computed from recorded or mirrored channels."""
        available, absent = {*self.recorded, *self.mirrored}, {*self.left_out, *self.unresolved}
        return tuple(
            name
            for name in MUSCLES
            if not absent & set(sources_of(name)) and available & set(sources_of(name))
        )

    def channels_behind(self, name: str) -> tuple[str, ...]:
        """Recorded channels that a muscle, or a channel, is computed from; copies name their source."""
        measured = (name,) if name in CHANNELS else sources_of(name)
        behind = {c: c for c in self.recorded} | {c: _opposite(c) for c in self.mirrored}
        return tuple(behind[c] for c in measured if c in behind)

    @property
    def sentence(self) -> str:
        """Describe the recorded channels and the treatment of the others."""
        if len(self.recorded) == len(CHANNELS):
            parts = [f"all {len(CHANNELS)} channels were recorded"]
        else:
            parts = [
                f"{len(self.recorded)} of {len(CHANNELS)} channels were recorded "
                f"({', '.join(self.recorded) or 'none'})"
            ]
        groups = (
            ("copied from the other side", self.mirrored),
            ("taken as zero", self.zero),
            ("left out", self.left_out),
            ("missing without a chosen treatment", self.unresolved),
            ("recorded and not used", self.ignored),
        )
        parts += [f"{what}: {', '.join(names)}" for what, names in groups if names]
        without = [name for name in MUSCLES if name not in self.estimated]
        if without:
            parts.append(f"muscles without an estimated activation: {', '.join(without)}")
        return "; ".join(parts)

    def demand(self, wanted: Iterable[str], strategy: str) -> None:
        """Refuse a strategy that requires a muscle whose missing channels have no treatment.

        `wanted` are the muscles, without side, that the strategy requires. The SchemaError states
        the missing channels and the possible treatments.
        """
        needs = set(wanted)
        lacking = [
            channel
            for channel in self.unresolved
            if any(channel in sources_of(m) for m in MUSCLES if m.rpartition("_")[0] in needs)
        ]
        if not lacking:
            return
        raise SchemaError(
            f"missing channel{'s' if len(lacking) > 1 else ''} {listed(lacking)} (found "
            f"{listed((*self.recorded, *self.ignored)) or 'none'}), which {strategy} needs; "
            f"expected the {len(CHANNELS)} channels of the study: map the labels of the recording, or "
            "choose signals.montage.missing_side (mirror, zero, leave_out) and "
            "signals.montage.missing_muscle (zero, leave_out), which the commands call --missing-side "
            "and --missing-muscle"
        )


COMPLETE: Final = Montage(CHANNELS)  #: montage of the study, seven muscles on each side


def montage_of(channels: Iterable[str], parameters: MontageParameters) -> Montage:
    """Determine the treatment of every channel of the study.

    Examples
    --------
    >>> choices = MontageParameters(missing_side="mirror", missing_muscle="leave_out")
    >>> montage_of(["ZYG_L"], choices).mirrored
    ('ZYG_R',)
    """
    names = list(channels)
    groups: dict[str, list[str]] = {}
    for name in CHANNELS:
        if name in names:
            treatment = "recorded"
        elif _opposite(name) in names:
            treatment = parameters.missing_side
        else:
            treatment = parameters.missing_muscle
        groups.setdefault(treatment, []).append(name)
    _require_spelling(
        (name for key, names_of in groups.items() if key in CHOSEN_TREATMENTS for name in names_of),
        names,
    )
    return Montage(
        *(
            tuple(groups.get(key, ()))
            for key in ("recorded", "mirror", "zero", "leave_out", "error")
        ),
        ignored=tuple(name for name in names if name not in CHANNELS),
    )


CHOSEN_TREATMENTS: Final = ("mirror", "zero", "leave_out")  #: chosen treatments of missing channels


def _require_spelling(missing: Iterable[str], names: list[str]) -> None:
    """Refuse to treat a channel as missing that the recording contains in another spelling."""
    spelled = {_letters(name): name for name in names if name not in CHANNELS}
    for name in missing:
        if other := spelled.get(_letters(name)):
            raise SchemaError(
                f"the recording has the channel {other!r}, while {name} counts as missing, expected one "
                f"spelling: rename it to {name} with a mapping"
            )


def _letters(name: str) -> str:
    """Letters and digits of a name in one case."""
    return "".join(filter(str.isalnum, name.casefold()))


def with_mirrored(emg: xr.DataArray, montage: Montage) -> xr.DataArray:
    """Return the recorded and mirrored channels (channel, time_emg) [V], in the order of the study.

    A mirrored channel contains the signal of the other side. Raises SchemaError if no channel of
    the study was recorded.
    """
    used = [name for name in CHANNELS if name in montage.recorded or name in montage.mirrored]
    if not used:
        raise SchemaError(
            f"the recording has the channels {listed(montage.ignored) or 'none'}, expected at "
            f"least one of {', '.join(CHANNELS)}: map its labels to these names"
        )
    sources = [name if name in montage.recorded else _opposite(name) for name in used]
    return emg.sel(channel=sources).assign_coords(channel=used)


def _opposite(channel: str) -> str:
    """Channel of the same muscle on the other side."""
    muscle, _, side = channel.rpartition("_")
    return f"{muscle}_{'R' if side == 'L' else 'L'}"
