"""The report of a study: JSON for programs, a page in Markdown and pictures for people.

Every figure comes from the run, whose command, machine, versions and seed the report names.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from armguard.lab.choice import SAME_LEVEL
from armguard.lab.pages import Column
from armguard.lab.tradeoff.figures import Figures
from armguard.lab.tradeoff.ladder import AUTO, AXES, DEFAULT, FINEST, OPERATING
from armguard.lab.tradeoff.study import CLOSE, Study

COLUMNS = (
    Column("tick p50, p99, max [µs]", "tick_p50 tick_p99 tick_max", "{:.0f}, {:.0f}, {:.0f}"),
    Column("message [µs]", "intake_p50", "{:.0f}"),
    Column("of a core", "core", "{:.1%}"),
    Column("evaluations, most", "evaluated evaluated_max", "{:.0f}, {:.0f}"),
    Column("÷ finest: p50, p5", "tight_finest tight_finest_p5", "{:.2f}, {:.2f}"),
    Column("STOP", "stop", "{:.1%}"),
    Column("SLOW", "slow", "{:.1%}"),
    Column("AWARE", "aware", "{:.1%}"),
    Column("work lost", "work_lost", "{:.1%}"),
    Column("same level", "same_level", "{:.1%}"),
    Column("late p50, max [ms]", "late_p50 late_max", "{:.0f}, {:.0f}"),
    Column("missed", "missed", "{:.0f}"),
)
"""Columns of the table for people."""

CHEAPER = 0.95
"""Share of a price below which another price is lower by more than measurements scatter."""

LEGEND = (
    "Times are processor time of one thread; ticks have the default's rate unless the setting "
    "states another.",
    "“Of a core” is the share of one core that steps and messages use.",
    "“÷ finest” is the contact time over that of the finest setting in the same tick, in the "
    "median and in the worst twentieth.",
    "“Work lost” is the share of the path that an arm loses if it obeys each verdict's speed "
    "scale.",
    "“Late” is the time from the finest setting's STOP to this setting's STOP.",
    "“Missed” are contacts of the true surface before their contact time, or without a STOP in "
    "time. Bodies that broke their stated bounds do not count.",
    "All settings judge the same states of an arm that ignores verdicts.",
    "Settings that differ in “operating” are not recommended: operating limits are a premise, not "
    "a choice. The arm here keeps to all of them.",
    "Settings with * are on the front: no other is both cheaper and no more cautious.",
)
"""Explains that table."""


def summarise(study: Study) -> list[str]:
    """Results by which a user can choose, one line each."""
    usual, finest = study.find(DEFAULT), study.find(FINEST)
    if usual is None or finest is None:
        return []
    found = [(one.setting, one.figures) for one in study.outcomes if one.figures is not None]
    bad = [setting.name for setting, figures in found if figures.missed > 0.0]
    offered = [
        (setting.name, figures)
        for setting, figures in found
        if setting.is_choice and setting.name not in bad
    ]
    lines = []
    if study.interrupted:
        lines.append(
            f"Interrupted in the part “{study.interrupted}”: these results are from "
            f"{study.seconds:.1f} s of the scene; parts that had not begun are missing."
        )
    lines += [_tell_levels(finest), _tell_contacts(study)]
    if bad:
        lines.append(
            f"MISSED contacts: {', '.join(bad)}. Use none of these settings, and report it."
        )
    near = [one for one in offered if one[1].stop <= finest.stop + CLOSE]
    equal = [one for one in offered if one[1].same_level >= SAME_LEVEL]
    for text, fit in (
        ("whose STOP share is within 1 percentage point of the finest's", near),
        (f"with the finest's level in at least {SAME_LEVEL:.0%} of the ticks", equal),
    ):
        if fit:
            name, figures = min(fit, key=lambda one: one[1].core)
            lines.append(
                f"Cheapest setting {text}: **{name}**, {figures.core:.1%} of a core "
                f"at STOP {figures.stop:.1%} and the same level in {figures.same_level:.1%} "
                f"(finest: {finest.core:.1%} at STOP {finest.stop:.1%})."
            )
    if offered:
        name, figures = min(offered, key=lambda one: (one[1].stop, one[1].core))
        lines.append(f"Least STOP: **{name}**, {figures.stop:.1%} at {figures.core:.1%} of a core.")
    better = [
        name
        for name, figures in offered
        if figures.core < CHEAPER * usual.core and _is_as_free(figures, usual)
    ]
    place = (
        f"Cheaper and no more cautious here: {', '.join(better)}."
        if better
        else "Nothing here is both cheaper and no more cautious."
    )
    lines.append(
        f"The default takes {usual.core:.1%} of a core at STOP {usual.stop:.1%} and has the finest "
        f"setting's level in {usual.same_level:.1%} of the ticks, at "
        f"{usual.core / finest.core:.1%} of its price. {place}"
    )
    for setting, figures in found:
        if setting.axis == OPERATING:
            lines.append(
                f"Effect of operating limits: with **{setting.name}** STOP is "
                f"{figures.stop:.1%} and SLOW {figures.slow:.1%} instead of the default's "
                f"{usual.stop:.1%} and {usual.slow:.1%}, and {figures.work_lost:.1%} of the work "
                f"is lost instead of {usual.work_lost:.1%}. State only limits that the controller "
                f"enforces."
            )
    chosen = study.find(AUTO)
    if study.choice is not None and chosen is not None:
        settings, nearness, _ = study.choice.summary
        lines.append(
            f"**{AUTO}** chose {settings} by a trial of its own, where it {nearness}. Here it has "
            f"the finest setting's level in {chosen.same_level:.1%} of the ticks, at "
            f"{chosen.core / finest.core:.1%} of its processor time and "
            f"{chosen.evaluated / finest.evaluated:.1%} of its evaluations."
        )
    return lines


def describe(study: Study, title: str, facts: Mapping[str, str]) -> dict[str, Any]:
    """All results, as plain data.

    Args:
        study: What was found.
        title: The arm and what moved about it.
        facts: Command, machine, versions and seed, by name.
    """
    return {
        "title": title,
        **facts,
        "seconds": round(study.seconds, 3),
        "interrupted": study.interrupted,
        "summary": summarise(study),
        "front": study.front,
        "choice": study.choice,
        "settings": [
            {
                "name": one.setting.name,
                "axis": one.setting.axis,
                "refused": one.refused,
                "figures": one.figures,
            }
            for one in study.outcomes
        ],
        "contacts": study.contacts,
    }


def _is_as_free(figures: Figures, usual: Figures) -> bool:
    """Whether a setting is no more cautious than the default: no more STOP, nor SLOW beside it."""
    beside = usual.stop + usual.slow + CLOSE
    return figures.stop <= usual.stop and figures.stop + figures.slow <= beside


def _tell_levels(finest: Figures) -> str:
    """Share of each level in the scene."""
    shares = finest.stop, finest.slow, finest.aware
    names = zip(("STOP", "SLOW", "AWARE", "CLEAR"), (*shares, 1.0 - sum(shares)), strict=True)
    told = ", ".join(f"{name} {abs(share):.1%}" for name, share in names)
    return f"Levels of the finest setting in this scene: {told}."


def _tell_contacts(study: Study) -> str:
    """Number of true contacts, which shows how much “nothing missed” proves."""
    if study.contacts is None:
        return "Contacts in the scene: not computed, so missed contacts are unknown."
    beyond = sum(one.is_beyond for one in study.contacts)
    count = len(study.contacts) - beyond
    aside = f", and {beyond} with bodies beyond their stated bounds" if beyond else ""
    if not count:
        return f"Contacts in the scene: 0{aside}. No contact could be missed."
    return f"Contacts in the scene: {count}{aside}."


def tabulate(study: Study) -> tuple[list[str], list[list[str]]]:
    """The table for people: heads and rows, by axis; * marks settings on the front."""
    heads = ["setting", *(column.head for column in COLUMNS)]
    order = ["", *AXES, AUTO]
    rows = []
    for one in sorted(study.outcomes, key=lambda one: order.index(one.setting.axis)):
        name = f"{one.setting.name}{' *' if one.setting.name in study.front else ''}"
        if one.figures is None:
            rows.append([name, f"refused: {one.refused}", *[""] * (len(COLUMNS) - 1)])
        else:
            rows.append([name, *(column.show(one.figures) for column in COLUMNS)])
    return heads, rows
