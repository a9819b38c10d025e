"""Diagrams of ideas, without figures of the library: `python docs/make_sketches.py` draws them."""

from __future__ import annotations

from make_concepts import ARM, BODY, COLOURS, INK, PALE, Drawing

STOP = COLOURS["STOP"]
PAPER = "#eceff1"


def draw_arrow(drawing: Drawing, x: float, y: float, end: float, colour: str = INK) -> None:
    """A horizontal arrow from `x` to `end`."""
    tip = 7.0 if end > x else -7.0
    drawing.line([(x, y), (end, y)], colour)
    drawing.line([(end - tip, y - 5), (end, y), (end - tip, y + 5)], colour)


def draw_step(drawing: Drawing, x: float, lines: tuple[str, ...], width: float = 150.0) -> None:
    """A step of a tick: its name, and what it does."""
    drawing.box(x, 60, width, 96, PAPER)
    for number, words in enumerate(lines):
        drawing.text(x + width / 2, 82 + 19 * number, words)


def draw_tick() -> None:
    """What one tick does."""
    drawing = Drawing(780, 230)
    drawing.text(88, 24, "obstacle samples", fill=BODY)
    drawing.text(88, 42, "from each source", fill=BODY)
    drawing.text(88, 184, "joint state", fill=ARM)
    drawing.text(88, 202, "at up to 1 kHz", fill=ARM)
    steps = (
        ("1. Take in", "check samples", "and joint state;", "place the arm"),
        ("2. Look up", "which certificates", "lost a premise,", "or are due?"),
        ("3. Evaluate", "contact times of", "those pairs; at rest", "before contact?"),
        ("4. Answer", "level, times,", "speed scale,", "reasons"),
    )
    for number, lines in enumerate(steps):
        x = 13 + 196 * number
        draw_step(drawing, x, lines)
        if number:
            draw_arrow(drawing, x - 42, 108, x - 4)
    for top, low, colour in ((46, 58, BODY), (170, 160, ARM)):
        drawing.line([(88, top), (88, low)], colour)
    drawing.line([(676, 158), (676, 176)], INK)
    drawing.text(676, 194, "verdict to the controller,")
    drawing.text(676, 212, "valid for a few milliseconds")
    drawing.save("tick.svg", "What a tick does")


def draw_margins() -> None:
    """The stop time and the margins beyond it; the level by where the contact time lies."""
    drawing, left, base = Drawing(780, 210), 30.0, 92.0
    stop, slow, aware, end = 300.0, 430.0, 610.0, 750.0
    bands = (("STOP", left, stop), ("SLOW", stop, slow), ("AWARE", slow, aware))
    for name, begin, until in (*bands, ("CLEAR", aware, end)):
        drawing.box(begin, base - 42, until - begin, 28, COLOURS[name])
        fill = "white" if name in {"STOP", "CLEAR"} else INK
        drawing.text((begin + until) / 2, base - 23, name, fill=fill)
    drawing.text(390, 22, "level, by where the contact time lies")
    draw_arrow(drawing, left, base, end + 8)
    parts = (
        (30, 90, "period"),
        (90, 152, "latency"),
        (152, 222, "reaction"),
        (222, 300, "braking"),
    )
    for number, (begin, until, words) in enumerate(parts):
        drawing.box(begin + 1, base + 8, until - begin - 2, 14, PALE if number % 2 else ARM)
        drawing.text((begin + until) / 2, base + 38, words)
    drawing.text(left, base + 62, "now", anchor="start")
    for x, words, detail in (
        (stop, "stop time", "arm at rest"),
        (slow, "+ slow_margin", "0.1 s"),
        (aware, "+ aware_margin", "0.3 s"),
    ):
        drawing.line([(x, base - 48), (x, base + 68)], INK, "4 4")
        drawing.text(x, base + 84, words, fill=STOP if x == stop else INK)
        drawing.text(x, base + 102, detail, fill=STOP if x == stop else INK)
    drawing.save("margins.svg", "Stop time, margins and levels along time")


def draw_piece() -> None:
    """Speed along time: a committed piece, its stop, and the piece that replaces it."""
    drawing, left, base, top = Drawing(780, 290), 60.0, 220.0, 90.0
    first, second, rest, later = 230.0, 400.0, 430.0, 600.0
    drawing.line([(left, base), (740, base)], PALE)
    drawing.line([(left, base), (left, 60)], PALE)
    drawing.text(left - 8, 72, "speed", anchor="end")
    drawing.text(740, base + 18, "time", anchor="end")
    drawing.line([(first, top), (second, top), (later, base)], BODY, "6 4")
    drawing.line([(left, top), (first, top), (rest, base)], ARM)
    drawing.text((left + first) / 2, top - 12, "piece 1", fill=ARM)
    drawing.text((first + second) / 2, top - 12, "piece 2", fill=BODY)
    drawing.text(240, 200, "stop of piece 1", anchor="start", fill=ARM)
    drawing.text(548, 162, "stop of piece 2", anchor="start", fill=BODY)
    drawing.line([(first, 40), (first, base)], INK, "3 5")
    drawing.text(first, 20, "Piece 2 answered safe: follow it.", anchor="start")
    drawing.text(first, 37, "Not safe, or no answer: stay on piece 1.", anchor="start")
    for y, end, words, colour in (
        (244, rest, "proved until at rest", ARM),
        (270, later, "proved until at rest", BODY),
    ):
        begin = left if colour == ARM else first
        drawing.box(begin, y, end - begin, 16, colour)
        drawing.text(end + 8, y + 13, words, anchor="start", fill=colour)
    drawing.save("piece.svg", "Each committed piece ends with its own stop")


def draw_contact_limits() -> None:
    """Speed of a surface while the arm brakes, and from when on a contact is permitted."""
    drawing, left, base = Drawing(780, 280), 60.0, 200.0
    brakes, slow, rest, limit = 240.0, 470.0, 610.0, 140.0
    drawing.box(left, 40, slow - left, base - 40, "#fbe4ea")
    drawing.box(slow, 40, 730 - slow, base - 40, "#e3f1ee")
    drawing.line([(left, base), (740, base)], PALE)
    drawing.text(740, base + 18, "time", anchor="end")
    drawing.line([(left, limit), (730, limit)], STOP, "6 4")
    drawing.text(724, limit - 8, "limit of the region", anchor="end", fill=STOP)
    slope = (base - limit) / (rest - slow)
    peak = base - slope * (rest - brakes)
    peak = max(peak, 52.0)
    drawing.line([(left, peak + 14), (brakes, peak), (slow, limit), (rest, base)], ARM)
    drawing.text(
        left + 10, peak + 42, "bound on the speed of the surface", anchor="start", fill=ARM
    )
    for x, words in (
        (left, "now"),
        (brakes, "brakes engage"),
        (slow, "slow enough"),
        (rest, "at rest"),
    ):
        drawing.line([(x, base), (x, base + 6)], INK)
        drawing.text(x, base + 22, words, anchor="start" if x == left else "middle")
    drawing.text((left + slow) / 2, 30, "contact must be impossible", fill=STOP)
    drawing.text((slow + 730) / 2, 30, "contact is permitted", fill=BODY)
    drawing.text(390, 256, "Contact possible only after the arm is slow enough: no STOP is needed.")
    drawing.save("contact_limits.svg", "From when on a contact limit permits contact")


if __name__ == "__main__":
    draw_tick()
    draw_margins()
    draw_piece()
    draw_contact_limits()
