"""Pictures of axes and signs, as SVG without a ground; in the dark the site turns them over."""

from __future__ import annotations

from itertools import product
from math import atan2, cos, log10, radians, sin

STYLE = """<style>
text{font:15px system-ui,'DejaVu Sans',sans-serif;fill:#222}
.small{font-size:13px;fill:#555}.title{font-weight:600}
.line,.red,.green,.blue,.grey{fill:none;stroke-width:2.4;stroke-linecap:round;stroke-linejoin:round}
.line{stroke:#222}.thin{stroke-width:1.2}.dash{stroke-dasharray:5 5}
.red{stroke:#c62828}.green{stroke:#2e7d32}.blue{stroke:#1565c0}.grey{stroke:#888}
.head.line{fill:#222}.head.red,text.red{fill:#c62828}.head.green,text.green{fill:#2e7d32}
.head.blue,text.blue{fill:#1565c0}.head.grey,text.grey{fill:#777}
text.red,text.green,text.blue,text.grey{stroke:none}
.face{fill:#9aa7b8;fill-opacity:.25;stroke:#667;stroke-width:1.2}
.box{fill:#eef1f5;stroke:#667;stroke-width:1.2}
.grey.thin{opacity:.7}.head.thin{stroke-width:1}
</style>"""

Point = tuple[float, float]


class Sheet:
    """A drawing; x to the right, y down [pixel]."""

    def __init__(self, width: int, height: int, about: str) -> None:
        self.head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            f'width="{width}" height="{height}" role="img">\n<title>{about}</title>\n{STYLE}'
        )
        self.parts: list[str] = []

    def text(self, at: Point, words: str, style: str = "", anchor: str = "start") -> None:
        """Write words; the point is the beginning, middle or end of their base line."""
        self.parts.append(
            f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" class="{style}" '
            f'text-anchor="{anchor}">{words}</text>'
        )

    def path(self, points: list[Point], style: str = "line", closed: bool = False) -> None:
        """Draw a line through points."""
        words = " L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        self.parts.append(f'<path d="M{words}{" Z" if closed else ""}" class="{style}"/>')

    def arrow(self, start: Point, end: Point, style: str = "line") -> None:
        """Draw an arrow."""
        self.path([start, end], style)
        self._tip(end, atan2(end[1] - start[1], end[0] - start[0]), style)

    def arc(
        self, centre: Point, radius: Point, first: float, last: float, style: str = "line"
    ) -> None:
        """Draw part of an ellipse with a tip at its end; angles clockwise from the right [deg]."""
        angles = [radians(first + (last - first) * i / 40) for i in range(41)]
        points = [(centre[0] + radius[0] * cos(a), centre[1] + radius[1] * sin(a)) for a in angles]
        self.path(points, style)
        (x0, y0), (x1, y1) = points[-4], points[-1]
        self._tip((x1, y1), atan2(y1 - y0, x1 - x0), style)

    def _tip(self, at: Point, angle: float, style: str) -> None:
        wings = [(at[0] - 11 * cos(angle + s), at[1] - 11 * sin(angle + s)) for s in (0.42, -0.42)]
        colour = style.split()[0]
        self.path([at, *wings], f"head {colour}", closed=True)

    def svg(self) -> str:
        """Return the whole file."""
        return "\n".join([self.head, *self.parts, "</svg>"]) + "\n"


def turned(points: list[Point], angle: float, centre: Point) -> list[Point]:
    """Turn points clockwise by an angle [deg] and move them to the centre."""
    c, s = cos(radians(angle)), sin(radians(angle))
    return [(centre[0] + c * x - s * y, centre[1] + s * x + c * y) for x, y in points]


CRAFT = [(0.0, -46.0), (20.0, -10.0), (20.0, 40.0), (-20.0, 40.0), (-20.0, -10.0)]
"""A vehicle from above, its nose up in the picture [pixel]."""

SIDE = [(-55.0, -12.0), (25.0, -12.0), (58.0, 4.0), (25.0, 14.0), (-55.0, 14.0)]
"""The same from its right, its nose to the right."""

REAR = [(-52.0, -4.0), (-16.0, -20.0), (16.0, -20.0), (52.0, -4.0), (52.0, 8.0), (-52.0, 8.0)]
"""The same from behind."""


def oblique(x: float, y: float, z: float, centre: Point, scale: float = 1.0) -> Point:
    """Return where a point in space comes to lie: x right, y into the picture, z up."""
    return centre[0] + scale * (x + 0.52 * y), centre[1] - scale * (z + 0.42 * y)


def frames() -> str:
    sheet = Sheet(720, 300, "The axes n: east, north, up; the axes b: right, forward, up")
    left, right = (110.0, 215.0), (455.0, 200.0)
    for name, axis, style in (
        ("x: east", (120, 0, 0), "red"),
        ("y: north", (0, 150, 0), "green"),
        ("z: up", (0, 0, 130), "blue"),
    ):
        tip = oblique(*axis, left)
        sheet.arrow(left, tip, style)
        sheet.text((tip[0] + 8, tip[1] + 5), name, style)
    sheet.text((60, 30), "n, level at a place", "title")
    a, b, c = 46, 70, 26  # half sides of the case
    corners = {
        (i, j, k): oblique(i * a, j * b, k * c, right) for i, j, k in product((-1, 1), repeat=3)
    }
    for face in (
        [(-1, -1, -1), (1, -1, -1), (1, -1, 1), (-1, -1, 1)],
        [(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)],
        [(1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1)],
    ):
        sheet.path([corners[p] for p in face], "face", closed=True)
    for name, begin, end, style in (
        ("x: right", (a, 0, 0), (a + 85, 0, 0), "red"),
        ("y: forward", (0, b, 0), (0, b + 100, 0), "green"),
        ("z: up", (0, 0, c), (0, 0, c + 90), "blue"),
    ):
        tip = oblique(*end, right)
        sheet.arrow(oblique(*begin, right), tip, style)
        sheet.text((tip[0] + 8, tip[1] + 5), name, style)
    sheet.text((340, 30), "b, fixed to the instrument", "title")
    sheet.text((60, 285), "Level and at heading 0, b and n are parallel.", "small")
    return sheet.svg()


def angles() -> str:
    sheet = Sheet(720, 270, "Heading clockwise from north, pitch nose up, roll right side down")
    at = (120.0, 150.0)
    sheet.arrow(at, (120, 45), "grey")
    sheet.text((112, 38), "north", "grey", "end")
    sheet.path(turned(CRAFT, 40, at), "face", closed=True)
    sheet.arrow(at, turned([(0, -100)], 40, at)[0], "green")
    sheet.text((190, 66), "forward", "green")
    sheet.arc(at, (72, 72), -88, -54, "line")
    sheet.text((120, 225), "heading, clockwise", "title", "middle")
    sheet.text((120, 247), "seen from above", "small", "middle")

    at = (355.0, 140.0)
    sheet.path([(280, 140), (450, 140)], "grey dash")
    sheet.path(turned(SIDE, -22, at), "face", closed=True)
    sheet.arrow(at, turned([(105, 0)], -22, at)[0], "green")
    sheet.text((438, 92), "forward", "green")
    sheet.arc(at, (80, 80), -1, -18, "line")
    sheet.text((362, 225), "pitch, nose up", "title", "middle")
    sheet.text((362, 247), "seen from its right", "small", "middle")

    at = (595.0, 140.0)
    sheet.path([(510, 140), (690, 140)], "grey dash")
    sheet.path(turned(REAR, 22, at), "face", closed=True)
    sheet.arrow(at, turned([(95, 0)], 22, at)[0], "red")
    sheet.text((674, 196), "right", "red")
    sheet.arc(at, (78, 78), 1, 18, "line")
    sheet.text((598, 225), "roll, right side down", "title", "middle")
    sheet.text((598, 247), "seen from behind", "small", "middle")
    return sheet.svg()


def force() -> str:
    sheet = Sheet(720, 250, "At rest the accelerometer feels the support push up: +1 g")
    sheet.path([(40, 190), (330, 190)], "line")
    for i in range(10):
        sheet.path([(48 + 30 * i, 190), (38 + 30 * i, 204)], "grey thin")
    sheet.path([(150, 130), (230, 130), (230, 190), (150, 190)], "face", closed=True)
    sheet.arrow((190, 160), (190, 45), "blue")
    sheet.text((202, 60), "specific force f = +1 g,", "blue")
    sheet.text((202, 80), "up: what is read", "blue")
    sheet.arrow((175, 160), (175, 236), "grey")
    sheet.text((165, 232), "gravity: not felt", "grey", "end")
    readings = {"axis that points": "reads", "up": "+9.81 m/s²", "level": "0", "down": "−9.81 m/s²"}
    for i, (axis, value) in enumerate(readings.items()):
        style = "title" if i == 0 else ""
        sheet.text((430, 70 + 32 * i), axis, style)
        sheet.text((690, 70 + 32 * i), value, style, "end")
        sheet.path([(430, 80 + 32 * i), (690, 80 + 32 * i)], "grey thin")
    sheet.text((430, 215), "The other way round? reads = &quot;gravity&quot;", "small")
    return sheet.svg()


def direction() -> str:
    sheet = Sheet(720, 290, "C_nb maps components from b to n: its columns are the axes of b in n")
    at, turn = (150.0, 200.0), 30.0
    for name, tip, style, label in (
        ("east", (290.0, 200.0), "grey", (296.0, 206.0)),
        ("north", (150.0, 50.0), "grey", (142.0, 46.0)),
    ):
        sheet.arrow(at, tip, style)
        sheet.text(label, name, style, "start" if name == "east" else "end")
    for name, axis, style in (("right", (110.0, 0.0), "red"), ("forward", (0.0, -140.0), "green")):
        tip = turned([axis], turn, at)[0]
        sheet.arrow(at, tip, style)
        sheet.text((tip[0] + 8, tip[1] + 4), name, style)
    sheet.arc(at, (62, 62), -89, -64, "line")
    sheet.text((168, 130), "ψ", "")
    sheet.text((380, 70), "x_n = C_nb x_b", "title")
    sheet.text((380, 100), "The columns of C_nb are the axes of b in n:")
    sheet.text((380, 128), "right = (cos ψ, −sin ψ, 0)", "red")
    sheet.text((380, 152), "forward = (sin ψ, cos ψ, 0)", "green")
    sheet.text((380, 182), "for a level instrument at heading ψ.")
    sheet.text((380, 212), "Inner letters cancel: C_nk = C_nt C_tk")
    sheet.text((150, 270), "level, seen from above", "small", "middle")
    return sheet.svg()


def lever_arm() -> str:
    sheet = Sheet(720, 240, "A lever arm points from the master, or the origin, to the sensor")
    hull = [(80.0, 190.0), (60.0, 120.0), (520.0, 120.0), (600.0, 150.0), (560.0, 190.0)]
    sheet.path(hull, "face", closed=True)
    sheet.text((585, 112), "forward →", "green", "middle")
    master, slave = (330.0, 60.0), (150.0, 152.0)
    for (x, y), name in ((master, "master"), (slave, "slave")):
        box = [(x - 16, y - 12), (x + 16, y - 12), (x + 16, y + 12), (x - 16, y + 12)]
        sheet.path(box, "face", closed=True)
        sheet.text((x, y - 20 if name == "master" else y + 32), name, "title", "middle")
    sheet.path([master, (330.0, 120.0)], "grey")
    sheet.arrow(master, slave, "red")
    sheet.text((222, 98), "r", "red")
    sheet.text((372, 44), "The slave behind and below the master:")
    sheet.text((372, 70), "right 0, forward −1.2 m, up −0.6 m", "red")
    words = "In the axes of the master; within one instrument from its origin to the sensor."
    sheet.text((60, 222), words, "small")
    return sheet.svg()


def misalignment() -> str:
    sheet = Sheet(720, 270, "Misalignment yx: the input axis of y leans towards x")
    at = (120.0, 210.0)
    sheet.arrow(at, (300, 210), "red")
    sheet.text((306, 216), "x, input axis of the x accelerometer", "red")
    sheet.arrow(at, (120, 50), "grey")
    sheet.text((112, 50), "y", "grey", "end")
    tip = turned([(0, -165)], 18, at)[0]
    sheet.arrow(at, tip, "green")
    sheet.text((tip[0] + 10, tip[1] + 8), "input axis of the y accelerometer", "green")
    sheet.arc(at, (120, 120), -90, -73, "line")
    sheet.text((128, 82), "m", "")
    sheet.text((330, 120), "accel.misalignment.yx = m &gt; 0:")
    sheet.text((330, 144), "y reads f_y + m f_x, output axis first.")
    words = "Gauge: x of the body is this x; y of the body lies in the plane of the two."
    sheet.text((60, 256), words, "small")
    return sheet.svg()


def table() -> str:
    sheet = Sheet(720, 300, "Axes of a table: outer vertical, middle carried by it, inner by that")
    at = (230.0, 190.0)
    for name, axis, style, offset in (
        ("middle, x of the case", (150, 0, 0), "red", (8, 20)),
        ("inner, y of the case", (0, 190, 0), "green", (10, 4)),
        ("outer, z of the case, vertical", (0, 0, 150), "blue", (10, 2)),
    ):
        tip = oblique(*axis, at)
        sheet.arrow(at, tip, style)
        sheet.text((tip[0] + offset[0], tip[1] + offset[1]), name, style)
    sheet.arc((230, 75), (42, 13), 160, -160, "blue")
    sheet.arc((338, 190), (12, 38), 70, -250, "red")
    sheet.arc((302, 133), (26, 26), -220, 60, "green")
    for i, line in enumerate(
        (
            "All angles zero: the case is parallel to the axes. Each axis turns right-handed:",
            "a spin of the outer axis is positive counter-clockwise seen from above.",
        )
    ):
        sheet.text((60, 262 + 22 * i), line, "small")
    return sheet.svg()


def which_number() -> str:
    """Draw an Allan deviation with N and K on it, and what receivers make of them."""
    sheet = Sheet(760, 330, "N and K on an Allan plot, and what receivers make of them")
    left, top, decade = 60.0, 30.0, 62.0

    def at(tau: float, sigma: float) -> Point:  # 0.01 s to 3000 s, in units of N at 1 s
        return left + decade * (log10(tau) + 2), top + 130 - decade * log10(sigma)

    times = [10 ** (k / 10) for k in range(-20, 35)]
    flat, K = 0.16, 0.02
    sheet.path([(left, top - 10), (left, 285), (at(3000, 1)[0], 285)], "grey")
    sheet.text((at(3000, 1)[0], 305), "averaging time", "small", "end")
    sheet.text((left + 6, top - 2), "deviation", "small")
    low = [(t, (1 / t + flat**2 + K**2 * t / 3) ** 0.5) for t in times]
    high = [(t, (1.25 / t + (3.0 * K) ** 2 * t / 3) ** 0.5) for t in times if t <= 400]
    sheet.path([at(*p) for p in low], "line")
    sheet.path([at(*p) for p in high], "blue dash")
    sheet.path([at(0.05, 0.05**-0.5), at(12, 12**-0.5)], "green thin")
    sheet.path([at(3, K), at(3000, K * 1000**0.5)], "red thin")
    for tau, sigma, word, style in ((1.0, 1.0, "N at 1 s", "green"), (3.0, K, "K at 3 s", "red")):
        x, y = at(tau, sigma)
        sheet.path([(x, 285), (x, y)], "grey thin dash")
        green = style == "green"
        sheet.text(
            (x - 8, y + 16) if green else (x + 8, y + 16), word, style, "end" if green else "start"
        )
    sheet.text(at(9, 0.95), "N and K that bound it", "blue")
    sheet.text(at(0.013, 1.5), "measured")
    x = 430.0
    for k, (what, white, walk, who) in enumerate((
        ("sigma density", "N", "K", "Kalibr, OpenVINS, ORB-SLAM3, LIO-SAM, Basalt"),
        ("variance density", "N²", "K²", "GTSAM, ROVIO"),
        ("sample sigma", "√2 N √rate", "K √rate", "VINS-Mono, VINS-Fusion"),
        ("sample variance", "N² rate", "K² rate", "FAST-LIO2, sensor_msgs/Imu"),
        ("Markov sigma", "N", "K √(T/2)", "KF-GINS, PSINS, gnss-ins-sim"),
    )):  # fmt: skip
        y = top + 12 + 58 * k
        sheet.text((x, y), what, "title")
        sheet.text((x + 160, y), white, "green")
        sheet.text((x + 260, y), walk, "red")
        sheet.text((x, y + 19), who, "small")
    return sheet.svg()


PICTURES = {
    "which_number": which_number,
    "frames": frames,
    "angles": angles,
    "force": force,
    "direction": direction,
    "lever_arm": lever_arm,
    "misalignment": misalignment,
    "table": table,
}
"""Name of the file in docs/images -> what draws it."""
