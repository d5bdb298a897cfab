"""The diagram of the phases, made of the machine's table, as text for mermaid."""

from __future__ import annotations

from pips_drake.remote_manipulator.phases import PHASES, TABLE, TRANSITIONS, Phase

#: The arrows' labels: guards in words.
_GUARDS = {
    "": "",
    "inside_bay": ", in the bay",
    "outside_bay": ", outside the bay",
    "berthed": ", in the bay's latches",
    "adrift": ", elsewhere",
}


def phase_diagram() -> str:
    """A mermaid state diagram: a state a phase, an arrow a transition; `reset` is in a note."""
    lines = ["stateDiagram-v2"]
    for phase, name in zip(Phase, PHASES, strict=True):
        facts = TABLE[phase]
        holders = [facts.support] * (facts.support != "none") + ["effector"] * facts.grasped
        held = f"held by {' and '.join(holders)}" if holders else "held by nothing"
        lines.append(f"    {name}: {name.replace('_', ' ')} (mode {facts.mode}, {held})")
    starts = [phase for phase in Phase if not TABLE[phase].grasped]
    lines += [f"    [*] --> {PHASES[phase]}" for phase in starts]
    for arrow in TRANSITIONS:
        label = arrow.event.name.lower().replace("_", " ") + _GUARDS[arrow.guard]
        lines.append(f"    {PHASES[arrow.source]} --> {PHASES[arrow.target]}: {label}")
    lines.append("    note left of stowed: reset leads from every phase to the scenario's first")
    return "\n".join(lines) + "\n"
