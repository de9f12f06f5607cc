"""Draw the vehicle with the symbols of docs/method.md.

python docs/pictures/geometry.py docs/pictures/geometry.svg
"""

import math
import sys

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Arc

WHEELBASE = 1.4
HITCH_OFFSET = 0.45
DRAWBAR = 0.9
TRAILER = 1.3
PSI_T = math.radians(38.0)
PSI_D = math.radians(14.0)
PSI_I = math.radians(-16.0)
DELTA_T = math.radians(22.0)
TRACK = 0.9

Point = tuple[float, float]


def behind(point: Point, angle: float, length: float) -> Point:
    """Return the point a length behind another along an angle."""
    return point[0] - length * math.cos(angle), point[1] - length * math.sin(angle)


def draw_wheel(axes: Axes, centre: Point, angle: float, length: float = 0.42) -> None:
    """Draw a wheel from above."""
    front = behind(centre, angle, -0.5 * length)
    rear = behind(centre, angle, 0.5 * length)
    axes.plot(*zip(front, rear, strict=True), color="0.25", linewidth=7, solid_capstyle="butt")


def draw_axle(axes: Axes, centre: Point, body: float, wheels: float) -> None:
    """Draw an axle across a body, with a wheel on each side at its own angle."""
    left = behind(centre, body + 0.5 * math.pi, -0.5 * TRACK)
    right = behind(centre, body + 0.5 * math.pi, 0.5 * TRACK)
    axes.plot(*zip(left, right, strict=True), color="0.25", linewidth=2)
    draw_wheel(axes, left, wheels)
    draw_wheel(axes, right, wheels)


def draw_beam(axes: Axes, front: Point, rear: Point, symbol: str, colour: str) -> None:
    """Draw a beam of a body, with the symbol of its length beside it."""
    axes.plot(*zip(front, rear, strict=True), color=colour, linewidth=4)
    middle = (0.5 * (front[0] + rear[0]), 0.5 * (front[1] + rear[1]))
    axes.annotate(symbol, middle, (-14, 8), textcoords="offset points", fontsize=13)


def draw_angle(axes: Axes, at: Point, begin: float, end: float, radius: float, name: str) -> None:
    """Draw an angle from `begin` to `end`, with its dashed first leg."""
    leg = behind(at, begin, -radius - 0.25)
    axes.plot(*zip(at, leg, strict=True), color="0.5", linewidth=0.9, linestyle="--")
    low = math.degrees(min(begin, end))
    high = math.degrees(max(begin, end))
    axes.add_patch(Arc(at, 2.0 * radius, 2.0 * radius, theta1=low, theta2=high, color="0.3"))
    middle = behind(at, 0.5 * (begin + end), -radius - 0.2)
    axes.text(*middle, name, ha="center", va="center", fontsize=13)


def main() -> None:
    """Draw the picture."""
    plt.rcParams |= {"svg.hashsalt": "geometry", "mathtext.fontset": "stix"}
    figure, axes = plt.subplots(figsize=(8.0, 3.7), layout="constrained")
    rear_axle = (0.0, 0.0)
    front_axle = behind(rear_axle, PSI_T, -WHEELBASE)
    rj1 = behind(rear_axle, PSI_T, HITCH_OFFSET)
    rj2 = behind(rj1, PSI_D, DRAWBAR)
    trailer_axle = behind(rj2, PSI_I, TRAILER)

    draw_beam(axes, front_axle, rear_axle, "$L_t$", "#C0392B")
    draw_beam(axes, rear_axle, rj1, "$a$", "#C0392B")
    draw_beam(axes, rj1, rj2, "$d$", "0.55")
    draw_beam(axes, rj2, trailer_axle, "$L_i$", "#1E8449")
    draw_axle(axes, rear_axle, PSI_T, PSI_T)
    draw_axle(axes, front_axle, PSI_T, PSI_T + DELTA_T)
    draw_axle(axes, trailer_axle, PSI_I, PSI_I)

    draw_angle(axes, front_axle, PSI_T, PSI_T + DELTA_T, 0.75, r"$\delta_t$")
    draw_angle(axes, rear_axle, 0.0, PSI_T, 0.85, r"$\psi_t$")
    draw_angle(axes, rj2, PSI_I, PSI_D, 0.85, r"$\delta_i$")
    draw_angle(axes, trailer_axle, 0.0, PSI_I, 0.95, r"$\psi_i$")
    for point, name, offset in (
        (rear_axle, "tractor point $(x, y)$", (62, -18)),
        (rj1, "RJ1", (-26, 9)),
        (rj2, "RJ2", (-16, -22)),
        (trailer_axle, "trailer point", (-88, -4)),
    ):
        axes.plot(*point, "o", color="black", markersize=5)
        axes.annotate(name, point, offset, textcoords="offset points", fontsize=11)
    axes.set(aspect="equal")
    axes.axis("off")
    figure.savefig(sys.argv[1], metadata={"Date": None})


if __name__ == "__main__":
    main()
