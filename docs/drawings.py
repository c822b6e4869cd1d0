"""The drawings of the page on recording: `python docs/drawings.py` writes them to docs/pictures."""

import pathlib

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

FOLDER = pathlib.Path(__file__).parent / "pictures"
INK, GOOD, BAD, PALE = "#333333", "#1f77b4", "#d62728", "#dddddd"
VIEW = np.array([[0.87, -0.5, 0.0], [0.3, 0.52, 0.8]])  # from above, from the right


def panel(figure, place, title=""):
    axes = figure.add_axes(place)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title(title, fontsize=10, color=INK)
    return axes


def arrow(axes, start, stop, color=INK, width=1.6):
    axes.annotate("", stop, start, arrowprops={"arrowstyle": "-|>", "color": color, "lw": width, "shrinkA": 0, "shrinkB": 0})


def box(axes, turn):
    """A flat box whose axes are the columns of `turn`, with its z axis as an arrow."""
    half = np.array([0.5, 0.35, 0.15])
    faces = [(axis, sign) for axis in range(3) for sign in (-1, 1)]
    toward = np.cross(VIEW[0], VIEW[1])

    def depth(face):
        return float(toward @ (turn[:, face[0]] * face[1] * half[face[0]]))

    for axis, sign in sorted(faces, key=depth):
        first, second = (other for other in range(3) if other != axis)
        corners = []
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            point = np.zeros(3)
            point[[axis, first, second]] = sign * half[axis], a * half[first], b * half[second]
            corners.append(VIEW @ turn @ point)
        axes.fill(*np.array(corners).T, facecolor="#eef3f8" if depth((axis, sign)) > 0 else "white", edgecolor=INK, lw=1.2)
    arrow(axes, VIEW @ turn @ [0, 0, 0.15], VIEW @ turn @ [0, 0, 0.75], GOOD, 2)
    axes.set_xlim(-0.95, 0.95)
    axes.set_ylim(-0.95, 0.95)


def poses():
    """The six faces."""
    figure = Figure(figsize=(9, 1.9))
    x, y, z = np.eye(3)
    frames = {
        "z up": (x, y, z), "z down": (x, -y, -z), "z left": (z, y, -x), "z right": (-z, y, x), "z to the front": (x, z, -y),
        "z to the back": (x, -z, y),
    }  # fmt: skip
    for i, (name, columns) in enumerate(frames.items()):
        box(panel(figure, (i / 6, 0, 1 / 6, 0.84), name), np.column_stack(columns))
    return figure


def tumble():
    """Directions of the field on a sphere: from all sides, and from one plane."""
    figure = Figure(figsize=(7, 3.1))
    k = np.arange(160)
    polar = np.arccos(1 - 2 * (k + 0.5) / len(k))
    whole = np.stack([np.cos(2.4 * k) * np.sin(polar), np.sin(2.4 * k) * np.sin(polar), np.cos(polar)])
    angle = np.linspace(0, 2 * np.pi, 80)
    ring = np.stack([np.cos(angle), np.sin(angle), 0.03 * np.sin(9 * angle)])
    for i, (name, points, color) in enumerate((("turned about all axes", whole, GOOD), ("turned about one axis only", ring, BAD))):
        axes = panel(figure, (i / 2, 0, 0.5, 0.88), name)
        outline = np.linspace(0, 2 * np.pi, 100)
        axes.plot(np.cos(outline), np.sin(outline), color=PALE, lw=1.5)
        across = np.stack([np.cos(outline), np.sin(outline), 0 * outline])
        axes.plot(*(VIEW @ across), color=PALE, lw=1)
        axes.scatter(*(VIEW @ points), s=9, color=color)
        axes.set_xlim(-1.15, 1.15)
        axes.set_ylim(-1.1, 1.1)
    return figure


def rest():
    """What an hour at rest looks like, and what spoils it."""
    figure = Figure(figsize=(8, 2.2))
    random = np.random.default_rng(3)
    t = np.linspace(0, 1, 500)
    signal = 0.08 * random.standard_normal(len(t)) + np.cumsum(random.standard_normal(len(t))) * 0.006
    bad = signal - 1.2 * np.exp(-t / 0.07)
    bad[300:325] += 0.9 * np.sin(np.arange(25))
    for i, (name, values, color) in enumerate((("warm, and left alone", signal, GOOD), ("cold at the start, and bumped", bad, BAD))):
        axes = figure.add_axes((0.03 + i / 2, 0.2, 0.44, 0.62))
        axes.plot(t, values, color=color, lw=0.7)
        axes.set_ylim(-1.5, 1.2)
        axes.set_title(name, fontsize=10, color=INK)
        axes.set_xlabel("one hour", fontsize=9, color=INK)
        axes.set_xticks([])
        axes.set_yticks([])
    return figure


def table():
    """A turntable from above, with four positions."""
    figure = Figure(figsize=(7.4, 2.1))
    for i, angle in enumerate((0, 90, 180, 270)):
        axes = panel(figure, (i / 4, 0, 0.25, 0.86), f"{angle} degrees, rest 60 s")
        outline = np.linspace(0, 2 * np.pi, 100)
        axes.plot(np.cos(outline), np.sin(outline), color=INK, lw=1.3)
        direction = np.array([np.sin(np.deg2rad(angle)), np.cos(np.deg2rad(angle))])
        arrow(axes, (0, 0), 0.85 * direction, GOOD, 2)
        axes.text(*(1.22 * direction), "x", ha="center", va="center", fontsize=9, color=GOOD)
        axes.set_xlim(-1.5, 1.5)
        axes.set_ylim(-1.5, 1.5)
    return figure


def main():
    FOLDER.mkdir(exist_ok=True)
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "jaxcal", "font.family": "sans-serif"}):
        for draw in (poses, tumble, rest, table):
            draw().savefig(FOLDER / f"{draw.__name__}.svg", metadata={"Date": None}, transparent=False)


if __name__ == "__main__":
    main()
