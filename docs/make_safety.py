"""The page of safety notes: `python docs/make_safety.py` writes docs/safety.md."""

from __future__ import annotations

from pathlib import Path

from armguard.app.premises import Premise

PAGE = Path(__file__).resolve().parent / "safety.md"

HEAD = """# Safety notes

<!-- written by docs/make_safety.py; the premises stand in armguard/app/premises.py: change them there -->

armguard is software for research and integration, **no certified safety device**: use it beside the safety functions that your cell needs by law, never instead of them. It is not certified for any use, and nothing here claims that a cell which uses it conforms to a standard.

## What every verdict rests on

A CLEAR is a proof, and a proof has premises. armguard checks what it can, and says STOP where it finds one broken; the rest is up to you. `armguard run` and `armguard demo` say after their addresses how many premises there are; with `--premises` they print each in a line:
"""

LIMITS = """## What it does not do

- **It slows and stops near people.** A person may do anything within 10 m/s² and 2 m/s unless you know better, and the arm anything within its limits unless it shares its plan. Right beside a working arm that is SLOW for much of the time and STOP for some: the faster the arm, the more. [Usefulness](usefulness.md) says how much, for each kind of bound, beside the separation distance at its best and a rule that knows the future; `python benchmarks/bench_recordings.py` measures it with recordings of your own. Bounds will not be softened to look better.
- **A plan is taken at its word.** An arm that is told to follow one, and strays from it unseen between two joint states, is bounded only from the next joint state on. So is an arm that moves on no piece when it shows its first one, and goes on as it did since the answer was lost: show the first piece to a resting arm. An arm that leaves a committed piece to brake joint by joint, at an emergency stop or without power, is not covered on the way, unless the monitor was made with `leave="any"`.
- **Some pairs are out of scope.** Links that no watched joint moves (the base) are not watched. Contact of the arm with itself, and between obstacles, is not looked for.
- **It knows no forces.** It stops on any contact but those that are named as wanted, for a time or in a zone ([Contact that is wanted](contact.md)).
- **Python on a desktop kernel is no hard real time.** Late ticks are counted, and a verdict that comes late has expired: the arm brakes then ([what the kernel should be told](deploy.md#what-the-kernel-should-be-told)).

## What was tried against it

- [Faults on purpose](faults.md): some seventy faults in running processes, each noticed, with nobody touched.
- [At the extremes](extremes.md): single evaluations against exact arithmetic, ticks against an adversary.
- [The mathematics](mathematics.md): what is proved, from which premise, and how rounding is accounted for.
- [How much an arm has to stop](usefulness.md): what the caution costs.
"""


def write_page() -> str:
    """The page, in Markdown."""
    premises = "\n".join(
        f"- **{premise.text[0].upper()}{premise.text[1:]}.** {premise.explanation}"
        for premise in Premise
    )
    return f"{HEAD}\n{premises}\n\n{LIMITS}"


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
