"""`Cell`: makes robot, obstacles and monitor from a cell file.

The file describes one cell: the arm and its placement, the sensors and their clocks, the statics,
and the settings of the monitor. Runs, replays and studies use the same file.
"""

from __future__ import annotations

from collections.abc import Callable
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import coal
import numpy as np
import pinocchio
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from armguard.app.cell.frames import Placement, place_bodies, read_rotation, resolve_frames
from armguard.app.cell.schema import (
    SETTINGS_TABLES,
    ArmTable,
    FrankaTable,
    IgnoreTable,
    OperatingTable,
    RobotTable,
    Ros2Table,
    SourceTable,
    ToolTable,
    UrTable,
    describe_table,
    given,
    make_error,
    parse_cell,
)
from armguard.exceptions import ArmguardError, CellError, RobotError
from armguard.monitor.monitor import Monitor
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.sources import Source
from armguard.people import BOUNDS
from armguard.robot.description import (
    DESCRIPTION,
    find_robot,
    is_known,
    locate_urdf,
    read_description,
)
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.robot import Robot
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from armguard.settings.declarations import read_declarations
from armguard.settings.schedule import DEADLINE
from armguard.settings.settings import Settings
from armguard.streams.authentication import Authenticator, Client
from armguard.streams.cloud_intake import OwnPoints
from armguard.streams.keys import KeyPair
from armguard.streams.source_accounts import SourceLimits
from armguard.streams.stamp_clocks import HELD_UP

if TYPE_CHECKING:
    from armguard.pairs.arm_obstacles import ArmObstacles
    from armguard.shield.shield import Shield

_T = TypeVar("_T")

AUTO = "auto"
"""Value of `settings` for settings that are chosen by a trial."""


class Cell:
    """A checked cell file; made by `Cell.load` or `Cell.from_text`.

    Args:
        text: TOML.
        file: What to call it in errors.
        folder: What paths in it are relative to.
        arm: Which of several arms is watched; None: the file has one.

    Attributes:
        file: Name of the file, for messages.
        arm: Name of the watched arm, in a cell with several arms.
        tables: The parsed content of the file.
        frames: Placements in the world by name, "world" and "base" (the robot's) among them.
    """

    def __init__(self, text: str, file: str, folder: Path, arm: str | None) -> None:
        self.file = file
        self.tables = tables = parse_cell(text, file, arm)
        self.arm = arm or ""
        self._folder = folder
        self._other_robots: dict[str, Robot] = {}
        self._check_robot(tables.robot)
        for other in self._other_arms:
            self._check_robot(other.as_robot())
            self._check_tool(other.tool)
        self._check_tool(tables.tool)
        self._check_sources()
        self._check_clients()
        self._check_settings()
        self._patterns = self._list_bounds()
        self._contact_limits = self._read_contact_limits()
        self._regions = self._list_regions()
        self.frames = resolve_frames(tables, file)
        frames = self._own_frames
        self._statics = place_bodies(tables.statics, "statics", frames, file)
        self._entrances = place_bodies(tables.entrances, "entrances", frames, file)

    @classmethod
    def load(cls, path: str | Path, arm: str | None = None) -> Cell:
        """Read a cell file; paths inside it are relative to its folder.

        Args:
            path: The file.
            arm: Which of several arms is watched; None: the file has one.

        Raises:
            CellError: If it cannot be read or says something impossible.
        """
        path = Path(path)
        try:
            text = path.read_bytes().decode()
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not UTF-8"
            raise CellError(str(path), f"cannot be read ({reason})") from None
        return cls(text, str(path), path.parent, arm)

    @classmethod
    def from_text(cls, text: str, folder: str | Path = ".", arm: str | None = None) -> Cell:
        """Read a cell from TOML text; paths inside it are relative to `folder`.

        Raises:
            CellError: If it says something impossible.
        """
        return cls(text, "cell", Path(folder), arm)

    def build(self) -> tuple[Robot, Obstacles, Monitor]:
        """Robot, obstacles and the monitor that watches them.

        Raises:
            CellError: If the robot cannot be made, or something in the file does not fit it.
        """
        robot = self.make_robot()
        obstacles = self.make_obstacles()
        return robot, obstacles, self.make_monitor(robot, obstacles)

    def describe(self) -> dict[str, Any]:
        """The content of the file as plain data, without paths, and the other arms made so far."""
        # For a run, once; most users of a cell do not ask.
        from armguard.robot.portable import describe_contents

        return {
            "arm": self.arm,
            "tables": describe_table(self.tables),
            "others": {
                name: describe_contents(robot) for name, robot in self._other_robots.items()
            },
        }

    @property
    def urdf(self) -> tuple[str, list[str]]:
        """Path of the robot's own URDF and its package folders; empty for a known robot."""
        table = self.tables.robot
        if table.urdf is None:
            name = self._find_robot(table)
            if is_known(name):
                return "", []
            directory = find_robot(name)
            urdf, packages = locate_urdf(directory, read_description(directory / DESCRIPTION))
            return str(urdf), [str(package) for package in packages]
        folders = [str(self._folder / folder) for folder in table.package_dirs]
        return str(self._folder / table.urdf), folders

    def find_driver(self) -> UrTable | FrankaTable | Ros2Table:
        """How `armguard drive` connects to the robot.

        Raises:
            CellError: The file does not say.
        """
        table = self.tables.robot.driver
        if table is None:
            example = '{ name = "ur", host = "…", model = "UR5e" }, or { name = "ros2" }'
            raise make_error(self.file, "robot.driver", "is missing", example)
        return table

    @property
    def sources(self) -> dict[str, SourceTable]:
        """The sources that the file names."""
        return {} if self.tables.sources is UNSET else self.tables.sources

    def _find_robot(self, table: RobotTable) -> str | Path:
        """The name or folder of a robot whose table names no URDF."""
        name = table.name or ""
        return name if is_known(name) else self._folder / name

    def make_robot(self) -> Robot:
        """The robot of the file, with its tool, and with errors that include its clock error."""
        return self._make_robot(self.tables.robot, self.tables.tool)

    def make_other_arms(self) -> list[ArmObstacles]:
        """The other arms of the cell, as obstacles for one table.

        Raises:
            CellError: One of them cannot be made.
        """
        made = []
        for other in self._other_arms:
            if other.name not in self._other_robots:
                self._other_robots[other.name] = self._make_robot(other.as_robot(), other.tool)
            robot, base = self._other_robots[other.name], self.frames[other.name]
            # Most cells have one arm.
            from armguard.pairs.arm_obstacles import ArmObstacles

            one = self._attempt(
                "robots",
                ArmObstacles,
                robot,
                other.name,
                base_placement=base.transform,
                placement_error=self.frames[self.arm].calibration_error + base.calibration_error,
                operating=self._read_operating(robot, other.operating),
            )
            made.append(one)
        return made

    @property
    def drawn_links(self) -> dict[str, tuple[str, ...]]:
        """Links that have only visual geometry, by the name of each other arm that was made."""
        return {name: robot.drawn_links for name, robot in self._other_robots.items()}

    @property
    def _other_arms(self) -> list[ArmTable]:
        return [one for one in self.tables.robots if one.name != self.arm]

    @property
    def _own_frames(self) -> dict[str, Placement]:
        """Frames that the file and its sources can name."""
        hidden = "base" if self.tables.robots else ""
        return {name: frame for name, frame in self.frames.items() if name != hidden}

    def _make_robot(self, table: RobotTable, tool: ToolTable | None) -> Robot:
        robot = self._make_bare_robot(table)
        joint_state = self.tables.joint_state
        # Comparing two clocks takes a moment, within which a stamp may be off.
        clock_error = joint_state.clock_error + HELD_UP * (joint_state.clock == "unix")
        if clock_error > 0.0:
            _allow_clock_error(robot, clock_error)
        if tool is not None:
            rotation = read_rotation("tool.quaternion", tool.quaternion, self.file)
            self._attempt("tool", attach_tool, robot, tool, rotation, self._folder)
        return robot

    def _make_bare_robot(self, table: RobotTable) -> Robot:
        cover = None if table.cover is None else self._folder / table.cover
        shared = {"joints": table.joints, "cover": cover, "level": table.level}
        if table.name is not None:
            found = self._find_robot(table)
            self._attempt("robot.name", find_robot, found)
            key = "robot.name" if cover is None else "robot.cover"
            return self._attempt(key, Robot.load, found, **shared)
        return self._attempt(
            "robot.urdf",
            Robot.from_urdf,
            self._folder / str(table.urdf),
            limits=self._folder / str(table.limits),
            package_dirs=[self._folder / folder for folder in table.package_dirs],
            **shared,
        )

    def make_obstacles(self) -> Obstacles:
        """The table of obstacles, with its sources, frames, statics, entrances and tethers."""
        bounds = {
            key: value
            for key, value in given(self.tables.bounds).items()
            if key not in read_declarations(Settings)
        }
        bounds["bounds"] = self._patterns
        bounds["regions"] = self._regions
        del bounds["of"]
        # An empty table says that there are no sources; none at all, that nothing is known of them.
        sources = None
        if self.tables.sources is not UNSET:
            sources = [
                Source(
                    name,
                    table.timeout,
                    table.required,
                    table.on_refusal,
                    latency=table.latency,
                    rate=table.rate,
                )
                for name, table in self.sources.items()
            ]
            sources += [Source(other.name) for other in self._other_arms]
        frames = {
            name: place.as_frame() for name, place in self._own_frames.items() if name != "world"
        }

        def make() -> Obstacles:
            obstacles = Obstacles(sources=sources, frames=frames, **bounds)
            for name, (points, radius) in self._statics.items():
                obstacles.add_static(name, points, radius)
            for other in self.make_other_arms():
                if not self._shares_base(other.name):
                    other.add_fixed(obstacles)
            return obstacles

        obstacles = self._attempt("bounds", make)
        for name, (points, radius) in self._entrances.items():
            table = self.tables.entrances[name]
            self._attempt(
                f"entrances.{name}",
                obstacles.add_entrance,
                name,
                points,
                radius,
                table.detection_time,
                table.speed,
            )
        for number, tether in enumerate(self.tables.tethers):
            values = tether.a, tether.b, tether.length, tether.source
            self._attempt(f"tethers[{number}]", obstacles.tether, *values)
        return obstacles

    def _shares_base(self, other: str) -> bool:
        """Whether the fixed links of another arm are also fixed links of the watched arm."""
        bases = {one.name: (one.robot, one.urdf, one.base) for one in self.tables.robots}
        return bases[self.arm] == bases[other]

    def make_authenticator(self) -> Authenticator | None:
        """The authenticator of the clients in `[keys]`; None without `[keys]`."""
        table = self.tables.keys
        if table is None:
            return None
        clients = {
            name: Client(client.public, frozenset(client.may), frozenset(client.arms))
            for name, client in table.clients.items()
        }
        pair = self._attempt("keys.secret", KeyPair.load, self._folder / table.secret)
        return self._attempt("keys.clients", Authenticator, pair, clients)

    @property
    def source_limits(self) -> dict[str, SourceLimits]:
        """The limits on messages of each source that the file names."""
        limits = {}
        for name, table in self.sources.items():
            stated = given(table).items()
            most = {key[4:]: value for key, value in stated if key.startswith("max_")}
            limits[name] = SourceLimits(**most)
        return limits

    def make_own_points(self, robot: Robot) -> OwnPoints | None:
        """The filter that removes the arm's own points from clouds; None without `[clouds]`."""
        table = self.tables.clouds
        if table is None:
            return None
        from armguard.pairs.cloud_filter import CloudFilter

        own = CloudFilter(robot, self.frames["base"].transform, **given(table))
        frames = {name: place.as_frame() for name, place in self.frames.items()}

        def find_others(
            points: NDArray[np.float64],
            q: NDArray[np.float64],
            frame: str,
            origin: tuple[float, float, float],
        ) -> NDArray[np.bool_]:
            if frame not in frames:
                raise ArmguardError("frame", f"{frame!r} is unknown")
            return own.find_others(points, q, frames[frame], origin)

        return OwnPoints(find_others, table.time_error)

    @property
    def keeps_cover(self) -> bool:
        """Whether the file sets the level of the cover, so that no trial chooses it."""
        return self.tables.robot.level is not None

    def make_monitor(self, robot: Robot, obstacles: Obstacles) -> Monitor:
        """The monitor with the file's settings; other settings have the defaults of `Monitor`.

        With `settings = "auto"`, a trial of some seconds chooses the other settings. It uses the
        recording that the file names, or a simulated person who approaches the working arm. The
        trial also chooses the level of the robot's cover, unless the file sets it.
        """
        monitor = self._make_monitor(robot, obstacles)
        for number, entry in enumerate(self.tables.ignore):
            if isinstance(entry, IgnoreTable):
                for link in self._find_links(robot, number, entry.link):
                    pair = link, entry.ids, entry.source
                    self._attempt(f"ignore[{number}]", monitor.ignore, *pair, zone=entry.zone)
        return monitor

    def _make_monitor(self, robot: Robot, obstacles: Obstacles) -> Monitor:
        settings = self.monitor_settings(robot)
        if self.tables.settings != AUTO:
            return self._attempt("", Monitor, robot, obstacles, **settings)
        recording = self.tables.settings_from
        key, trial = "settings", None
        if recording is not None:
            key, trial = "settings_from", self._folder / recording
        settings["keeps_cover"] = self.keeps_cover
        return self._attempt(key, Monitor.auto, robot, obstacles, trial, **settings)

    def make_shield(self, monitor: Monitor) -> Shield:
        """The shield that moves the arm, as `[shield]` says.

        Args:
            monitor: The monitor of this cell.

        Raises:
            CellError: The table, the rate or the motion is missing, or does not fit the robot.
        """
        # Most cells have none, and it brings libraries of its own.
        from armguard.shield.shield import Shield

        table = self.tables.shield
        if table is None:
            raise self._error("shield", "is missing", "[shield] with jerk")
        if "rate" not in given(self.tables.monitor):
            # The usual rate of a monitor is more than a shield can keep up with.
            raise self._error("monitor.rate", "is missing", "a rate of the shield's, as 250.0")
        rate = monitor.settings.rate
        return self._attempt("shield", Shield, monitor, rate=rate, **given(table))

    def monitor_settings(self, robot: Robot) -> dict[str, Any]:
        """The file's settings of the monitor, as keywords of `Monitor`."""
        stated = {
            key: value
            for table in (*SETTINGS_TABLES, "robot")
            for key, value in given(getattr(self.tables, table)).items()
            if key in read_declarations(Settings)
        }
        return {
            **stated,
            "ignore": self._expand_ignore(robot),
            "base_placement": self.frames["base"].transform,
            "contact_limits": self._contact_limits,
            "separation": self.tables.separation,
            "operating": self._read_operating(robot, self.tables.robot.operating),
        }

    def _list_bounds(self) -> list[tuple[str, float, float]]:
        """Bounds by pattern of ids; bounds of body parts are looked up."""
        listed = []
        for pattern, entry in self.tables.bounds.of.items():
            bounds = BOUNDS.get(entry) if isinstance(entry, str) else entry
            if bounds is None:
                expected = f"one of {', '.join(BOUNDS)}, or {{ accel = …, speed = … }}"
                raise self._error(f"bounds.of.{pattern}", f"is {entry!r}", expected)
            listed.append((pattern, bounds.accel, bounds.speed))
        return listed

    def _read_contact_limits(self) -> ContactLimits | None:
        """The contact limits of the file; None without any."""
        tables = self.tables.contact_limits
        limits = {
            region: ContactLimit(
                **{name: getattr(table, name) for name in ContactLimit.__struct_fields__}
            )
            for region, table in tables.items()
        }
        try:
            return ContactLimits(limits) if limits else None
        except ArmguardError as error:
            raise self._error(error.offender, error.problem, error.expected) from None

    def _list_regions(self) -> dict[str, str]:
        """Regions of a body by pattern of ids."""
        regions: dict[str, str] = {}
        for region, table in self.tables.contact_limits.items():
            for pattern in table.ids:
                if pattern in regions:
                    raise self._error(
                        f"contact_limits.{region}.ids",
                        f"has {pattern!r}, as contact_limits.{regions[pattern]}.ids",
                        "each pattern once",
                    )
                regions[pattern] = region
        return regions

    def _read_operating(
        self, robot: Robot, table: OperatingTable | str | UnsetType
    ) -> OperatingLimits | None:
        """The operating limits of the controller; None if the file has none."""
        if table is UNSET:
            return None
        if isinstance(table, str):
            return self._attempt("robot.operating", OperatingLimits.published, robot)
        limits = {
            key: value if isinstance(value, list) else value * getattr(robot, f"{key}_limit")
            for key, value in given(table).items()
        }
        operating = self._attempt("robot.operating", OperatingLimits, **limits)
        self._attempt("robot.operating", operating.resolve, robot)
        return operating

    def _check_robot(self, table: RobotTable) -> None:
        if (table.name is None) == (table.urdf is None):
            problem = (
                "has neither name nor urdf" if table.name is None else "has both name and urdf"
            )
            raise self._error("robot", problem, 'name = "panda", or urdf and limits')
        if table.urdf is not None and table.limits is None:
            raise self._error("robot.limits", "is missing", "a file of joint limits for the urdf")
        if table.name is not None:
            for key in ("limits", "package_dirs"):
                value = getattr(table, key)
                if value:
                    raise self._error(
                        f"robot.{key}",
                        f"is {value!r} beside robot.name",
                        "it only beside robot.urdf",
                    )
        if table.joints is not None and not 0 < len(table.joints) == len(set(table.joints)):
            raise self._error("robot.joints", f"is {table.joints!r}", "joint names, each once")

    def _check_tool(self, tool: ToolTable | None) -> None:
        if tool is None:
            return
        found = [shape for shape in SHAPES if getattr(tool, shape) is not None]
        if len(found) != 1:
            problem = f"has {' and '.join(found)}" if found else "has no geometry"
            raise self._error("tool", problem, f"one of {', '.join(SHAPES)}")
        read_rotation("tool.quaternion", tool.quaternion, self.file)

    def _check_sources(self) -> None:
        for name, table in self.sources.items():
            if table.clock == "arrival" and not table.latency > 0.0:
                raise self._error(
                    f"sources.{name}.latency",
                    f'is {table.latency} with clock = "arrival"',
                    "the longest time in seconds from measurement to arrival",
                )
            vague = f"clock_error = {table.clock_error}" if table.clock_error > 0.0 else ""
            vague = 'clock = "arrival"' if table.clock == "arrival" else vague
            for bound in ("speed", "accel"):
                if vague and bound not in given(self.tables.bounds):
                    raise self._error(
                        f"bounds.{bound}",
                        f"is missing with sources.{name}.{vague}",
                        "the bound, since it says how far things get between two clocks",
                    )
            if table.rate and table.timeout and not table.timeout * table.rate > 1.0:
                raise self._error(
                    f"sources.{name}.timeout",
                    f"is {table.timeout}",
                    f"longer than one period of its rate, {1.0 / table.rate:.4g} s",
                )

    def _check_clients(self) -> None:
        keys = self.tables.keys
        if keys is None:
            return
        for name in self.sources:
            client = keys.clients.get(name)
            if client is None or "obstacles" not in client.may:
                raise self._error(
                    f"sources.{name}",
                    "has no key, and so cannot speak",
                    f'[keys.clients.{name}] with may = ["obstacles"]',
                )

        arms = [one.name for one in self.tables.robots]
        expected = f"names among {', '.join(arms)}" if arms else "none: the cell has one arm"
        for name, client in keys.clients.items():
            key = f"keys.clients.{name}.arms"
            unknown = [arm for arm in client.arms if arm not in arms]
            if unknown:
                raise self._error(key, f"has {unknown[0]!r}", expected)
            if arms and "joints" in client.may and not client.arms:
                raise self._error(key, "is missing, so it could speak for no arm", expected)

    def _check_settings(self) -> None:
        tables = self.tables
        if tables.settings != AUTO:
            if tables.settings_from is not None:
                raise self._error("settings_from", "is given", f'settings = "{AUTO}" beside it')
            return
        if tables.robots:
            raise self._error("settings", f'is "{AUTO}" beside [[robots]]', '"stated"')
        schedule = given(tables.monitor).get("schedule", DEADLINE)
        if schedule != DEADLINE:
            raise self._error(
                "monitor.schedule",
                f'is {schedule!r} beside settings = "{AUTO}"',
                f'"{DEADLINE}", the one whose settings can be chosen',
            )

    def _expand_ignore(self, robot: Robot) -> list[tuple[str, ...]]:
        """The pairs that are never watched; excludes pairs that are exempt within a zone only."""
        return [
            (link, *entry[1:])
            for number, entry in enumerate(self.tables.ignore)
            if not isinstance(entry, IgnoreTable)
            for link in self._find_links(robot, number, entry[0])
        ]

    def _find_links(self, robot: Robot, number: int, pattern: str) -> list[str]:
        links = [link for link in robot.links if fnmatchcase(link, pattern)]
        if not links:
            raise self._error(
                f"ignore[{number}]",
                f"names the link {pattern!r}",
                f"a pattern that fits one of {', '.join(robot.links)}",
            )
        return links

    def _attempt(
        self, key: str, make: Callable[..., _T], *arguments: object, **keywords: object
    ) -> _T:
        """Call a constructor, and turn its errors into errors of this file."""
        try:
            return make(*arguments, **keywords)
        except CellError:
            raise
        except ArmguardError as error:
            key = self._find_key(error.offender) or key
            offender = f"{self.file}: {key}" if key else self.file
            problem = f"{error.offender}: {error.problem}"
            raise CellError(
                offender, problem, expected=error.expected, remedy=error.remedy
            ) from error

    def _find_key(self, offender: str) -> str:
        """The file's key of a setting that a constructor refused, if the file has that key."""
        if offender.startswith("ignore"):
            return "ignore"
        if offender in ("payload", "level"):
            return f"robot.{offender}"
        if self.tables.shield is not None and offender in given(self.tables.shield):
            return f"shield.{offender}"
        for table in SETTINGS_TABLES:
            if offender in given(getattr(self.tables, table)):
                return f"{table}.{offender}"
        return ""

    def _error(self, key: str, problem: str, expected: str) -> CellError:
        return make_error(self.file, key, problem, expected)


def _allow_clock_error(robot: Robot, clock_error: float) -> None:
    """Increase the robot's joint errors by the motion that is possible within the clock error.

    A state measured up to `clock_error` before or after its stamp differs from the state at the
    stamp by at most this motion. It would be unsafe to count the state as older instead: an arm
    that recedes from an obstacle would be assumed farther away than it is. At rest, the velocity
    is the same at all times, so that error stays.
    """
    fastest = robot.velocity_limit + robot.velocity_error
    robot.position_error = robot.position_error + fastest * clock_error
    robot.velocity_error = robot.velocity_error + robot.acceleration_limit * clock_error
    for errors in (robot.position_error, robot.velocity_error):
        errors.flags.writeable = False


SHAPES = ("sphere", "box", "capsule", "cylinder", "mesh")


def attach_tool(
    robot: Robot, table: ToolTable, rotation: NDArray[np.float64], folder: Path
) -> None:
    """Attach what `[tool]` describes.

    Args:
        robot: The robot that carries the tool.
        table: The tool's table in the cell file.
        rotation: Rotation of its geometry in the frame of the link's joint. Shape (3, 3).
        folder: Folder that the path of a mesh is relative to.

    Raises:
        RobotError: The link, the geometry or the mesh file is unusable.
        CoverError: No cover of the tool could be proved.
    """
    geometry = _make_geometry(table, folder)
    robot.attach(table.name, table.link, geometry, pinocchio.SE3(rotation, np.array(table.xyz)))


def _make_geometry(table: ToolTable, folder: Path) -> Any:
    if table.sphere is not None:
        return coal.Sphere(table.sphere)
    if table.box is not None:
        return coal.Box(*table.box)
    if table.capsule is not None:
        return coal.Capsule(table.capsule.radius, table.capsule.length)
    if table.cylinder is not None:
        return coal.Cylinder(table.cylinder.radius, table.cylinder.length)
    path = folder / str(table.mesh)
    try:
        return coal.MeshLoader().load(str(path), np.full(3, table.mesh_scale))
    except (ValueError, RuntimeError) as error:
        raise RobotError(
            str(path), "cannot be read as a mesh", expected="an STL, OBJ or DAE file"
        ) from error
