"""Pictures of docs/concepts.md, from real answers: `python docs/make_concepts.py` writes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import armguard
from armguard.bounds.free_body import free_displacement
from armguard.contact import earliest_contact_pair

FOLDER = Path(__file__).resolve().parent / "pictures"
COLOURS = {"CLEAR": "#4f9bd9", "AWARE": "#e3c93c", "SLOW": "#e8862e", "STOP": "#c8325a"}
INK, PALE, ARM, BODY = "#37474f", "#b0bec5", "#6d4c41", "#00796b"
HOME, STILL = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [0.0] * 7


class Drawing:
    """Marks in the order in which they are drawn."""

    def __init__(self, width: int, height: int) -> None:
        self.size = width, height
        self.marks: list[str] = []

    def text(self, x: float, y: float, words: str, **style: object) -> None:
        """Words at a place; `anchor` and `fill` as in SVG."""
        anchor, fill = style.get("anchor", "middle"), style.get("fill", INK)
        self.marks.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{fill}">{words}</text>'
        )

    def circle(self, x: float, y: float, radius: float, colour: str, *, filled: bool) -> None:
        """A body, or where one can be."""
        paint = f'fill="{colour}"' if filled else f'fill="{colour}" fill-opacity="0.18"'
        self.marks.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" {paint} stroke="{colour}"/>'
        )

    def line(self, points: list[tuple[float, float]], colour: str, dash: str = "") -> None:
        """Straight pieces from point to point."""
        way = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        dashes = f' stroke-dasharray="{dash}"' if dash else ""
        self.marks.append(
            f'<polyline points="{way}" fill="none" stroke="{colour}" stroke-width="2"{dashes}/>'
        )

    def box(self, x: float, y: float, width: float, height: float, colour: str) -> None:
        """A filled rectangle."""
        self.marks.append(
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" '
            f'fill="{colour}"/>'
        )

    def save(self, name: str, title: str) -> None:
        """Write the file."""
        width, height = self.size
        body = "\n".join(self.marks)
        (FOLDER / name).write_text(
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            f'width="{width}" height="{height}" font-family="sans-serif" font-size="13">\n'
            f"<title>{title}</title>\n"
            f'<rect width="{width}" height="{height}" fill="white"/>\n{body}\n</svg>\n',
            encoding="utf-8",
        )


def draw_reach() -> None:
    """Where two bodies can be, at three times up to the earliest contact."""
    gap, accel, speed, radius = 1.0, (6.0, 10.0), (1.5, 2.0), (0.08, 0.12)
    one = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], accel[0], speed[0]
    other = [gap, 0.0, 0.0], [0.0, 0.0, 0.0], accel[1], speed[1]
    tau = float(earliest_contact_pair(*one, *other, sum(radius)))
    drawing, scale = Drawing(780, 250), 120.0
    for panel, share in enumerate((0.0, 0.6, 1.0)):
        left, y = 20 + 250 * panel, 120.0
        drawing.text(left + 98, 20, f"t = {1e3 * share * tau:.0f} ms")
        for body, (x, colour) in enumerate(((0.0, ARM), (gap, BODY))):
            reach = free_displacement(0.0, accel[body], speed[body], share * tau)
            place = left + 35 + scale * x
            drawing.circle(place, y, scale * (radius[body] + reach), colour, filled=False)
            drawing.circle(place, y, scale * radius[body], colour, filled=True)
    drawing.text(
        390, 240, f"1 m apart, at rest: no contact before {1e3 * tau:.0f} ms, whatever both do"
    )
    drawing.save("reach.svg", "Where two bodies can be grows until both regions touch")


def draw_levels() -> None:
    """A ball flies at a resting arm: contact time, stop time and level."""
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(armguard.Robot.load("panda"), obstacles, rate=1000.0)
    told = []
    for tick in range(4600):
        now = 0.001 * tick
        if tick % 10 == 0:
            obstacles.update(["ball"], now, [[5.0 - now, 0.0, 0.6]], [[-1.0, 0.0, 0.0]], radius=0.1)
        verdict = monitor.step(now, HOME, STILL)
        told.append((now, verdict.contact_time, verdict.stop_time, verdict.level.name))
    drawing, left, base, wide, tall, top = Drawing(780, 300), 60, 240, 690, 200, 2.0
    end = told[-1][0]

    def at(now: float, time: float) -> tuple[float, float]:
        return left + wide * now / end, base - tall * min(time, top) / top

    begin = 0
    for number in range(1, len(told) + 1):
        if number == len(told) or told[number][3] != told[begin][3]:
            x, name = at(told[begin][0], 0.0)[0], told[begin][3]
            width = at(told[number - 1][0], 0.0)[0] - x
            drawing.box(x, base + 6, width, 16, COLOURS[name])
            if width > 40:
                drawing.text(x + width / 2, base + 19, name)
            begin = number
    for time in (0.0, 0.5, 1.0, 1.5, 2.0):
        drawing.line([at(0.0, time), at(end, time)], "#eceff1")
        drawing.text(left - 8, at(0.0, time)[1] + 4, f"{time:g} s", anchor="end")
    drawing.line([at(now, tau) for now, tau, _, _ in told[::20]], INK)
    drawing.line([at(now, stop) for now, _, stop, _ in told[::20]], COLOURS["STOP"], "5 4")
    drawing.text(left + 330, 75, "contact time", anchor="start")
    drawing.text(
        left + 8, at(0.0, told[0][2])[1] - 8, "stop time", anchor="start", fill=COLOURS["STOP"]
    )
    for now in range(5):
        drawing.text(at(float(now), 0.0)[0], base + 40, f"{now} s")
    drawing.save("levels.svg", "Contact time falls towards the stop time, and the level with it")


def draw_certificates() -> None:
    """A hand that rests in front of a resting arm: contact time and evaluations of each tick."""
    obstacles = armguard.Obstacles(sources=["camera"])
    monitor = armguard.Monitor(armguard.Robot.load("panda"), obstacles, rate=1000.0)
    told = []
    for tick in range(250):
        now = 10.0 + 0.001 * tick
        if tick % 10 == 0:
            obstacles.update(
                ["hand"], now, [[2.0, 0.0, 0.6]], [[0.0, 0.0, 0.0]], radius=0.1,
                position_error=0.02, source="camera",
            )  # fmt: skip
        verdict = monitor.step(now, HOME, STILL)
        told.append((tick, verdict.contact_time, verdict.evaluated))
    drawing, left, wide = Drawing(780, 330), 60, 690
    low, high = 0.4, 0.6
    x = np.linspace(left, left + wide, len(told))
    for time in (0.4, 0.45, 0.5, 0.55, 0.6):
        y = 170 - 150 * (time - low) / (high - low)
        drawing.line([(left, y), (left + wide, y)], "#eceff1")
        drawing.text(left - 8, y + 4, f"{time:g} s", anchor="end")
    places = [(x[tick], 170 - 150 * (tau - low) / (high - low)) for tick, tau, _ in told]
    drawing.line(places, INK)
    drawing.text(left + 10, 15, "contact time", anchor="start")
    most = max(count for _, _, count in told)
    for tick, _, count in told:
        if count:
            drawing.box(x[tick], 290 - 80 * count / most, 2.4, 80 * count / most, BODY)
    drawing.line([(left, 290), (left + wide, 290)], PALE)
    drawing.text(left + 10, 205, "evaluations in a tick", anchor="start", fill=BODY)
    drawing.text(left - 8, 290 - 72, str(most), anchor="end")
    for tick in range(0, 250, 50):
        drawing.text(x[tick], 312, f"{tick} ms")
    drawing.save("certificates.svg", "A certificate ends later than its tick: few ticks evaluate")


if __name__ == "__main__":
    draw_reach()
    draw_levels()
    draw_certificates()
