"""Cases: what the program is to solve, as TOML, and NumPy arrays in them."""

from __future__ import annotations

import itertools
import json
import os
import re
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from phasewarp.program import TEMPORARY, CaseError, PhasewarpError, StrPath, call

SPACE = ("x", "y", "z")
#: Longest value that is handed over on the command line; longer ones go into a file.
LONGEST_ARGUMENT = 10_000
#: Name of the files that cases without a file of their own are written to.
FILE = "case.toml"
#: Last line of such a file in the directory of a run: others are not replaced.
MARK = "# Written by the Python package of phasewarp for the run in this directory.\n"
#: Keys of formulas that an array could be meant for.
FORMULA = re.compile(r"initial\.(f|density)|potential\.\d+\.value|inflow\.value")
BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


class Case:
    """A case: a file as it stands, or tables given here, and values that replace some of its own.

    Values are read and replaced by dotted keys as ``--set`` of the program takes them; tables of a
    list are counted from 0. What a key means, and which there are, is in docs/usage.md. Keys that
    are not given have the program's defaults, which are not known here. The program checks a case
    when it is used; :func:`phasewarp.check` does nothing else.

    Parameters
    ----------
    source
        A TOML file, the tables of one, or a case, which is copied.
    **tables
        Further tables, which replace those of `source`.

    Examples
    --------
    >>> case = Case("cases/example1.toml")
    >>> case["solver.tolerance"] = 1e-9
    >>> case["axis.0.x.cells"]
    128
    >>> case = Case(
    ...     title="A barrier",
    ...     axis=[{
    ...         "x": {"lower": -1.0, "upper": 1.0, "cells": 64},
    ...         "v": {"lower": -1.5, "upper": 1.5, "cells": 64},
    ...     }],
    ...     potential=[{"where": "abs(x) < 0.25", "value": 0.2}, {"value": 0}],
    ...     initial={"f": "exp(-50*((x + 0.6)^2 + (v - 0.8)^2))"},
    ...     time={"end": 1.0},
    ... )
    """

    def __init__(
        self, source: Case | StrPath | Mapping[str, Any] | None = None, **tables: Any
    ) -> None:
        #: The file, or ``None`` for a case that was made here.
        self.path: Path | None = None
        self._tree: dict[str, Any] = {}
        self._settings: dict[str, Any] = {}
        # Keys of the file that this case does not have.
        self._removed: list[str] = []
        if isinstance(source, Case):
            self.path = source.path
            self._tree = deepcopy(source._tree)
            self._settings = deepcopy(source._settings)
            self._removed = list(source._removed)
        elif isinstance(source, Mapping):
            tables = {**source, **tables}
        elif source is not None:
            self.path = Path(source)
            with self.path.open("rb") as file:
                self._tree = tomllib.load(file)
        for key, value in tables.items():
            self[key] = value

    def __getitem__(self, key: str) -> Any:
        """Return the value of a dotted key; `KeyError` where the case does not give it."""
        value: Any = self._tree
        try:
            for part in key.split("."):
                value = value[index_of(value, part)]
        except LookupError:
            raise KeyError(f"{key}: not given in this case; the program has a default") from None
        return deepcopy(value)

    def __setitem__(self, key: str, value: Any) -> None:
        """Replace the value of a dotted key; a table replaces the whole table."""
        refuse_arrays(key, value)
        value = plain(value)
        *above, last = key.split(".")
        place: Any = self._tree
        try:
            for part in above:
                if isinstance(place, dict):
                    place.setdefault(part, {})
                place = place[index_of(place, part)]
            place[index_of(place, last)] = value
        except LookupError:
            raise KeyError(f"{key}: there is no such place in this case") from None
        # The program applies them in the order of their last assignment.
        self._settings.pop(key, None)
        self._settings[key] = deepcopy(value)

    def __delitem__(self, key: str) -> None:
        """Remove a dotted key, which has its default then; `KeyError` where it is not given."""
        if key not in self:
            raise KeyError(f"{key}: not given in this case")
        *above, last = key.split(".")
        place: Any = self._tree
        for part in above:
            place = place[index_of(place, part)]
        del place[index_of(place, last)]
        self._settings = {
            k: v for k, v in self._settings.items() if k != key and not k.startswith(f"{key}.")
        }
        self._removed.append(key)

    def __contains__(self, key: str) -> bool:
        try:
            self[key]
        except KeyError:
            return False
        return True

    def __repr__(self) -> str:
        if self.path is None:
            return f"<Case {self._tree.get('title', 'without title')!r}>"
        removed = [f"without {key}" for key in self._removed]
        return " ".join([f"<Case {self.path}", *self.settings(), *removed]) + ">"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Case) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def replace(self, values: Mapping[str, Any]) -> Case:
        """Return a copy in which the dotted keys of `values` have these values."""
        copy = deepcopy(self)
        for key, value in values.items():
            copy[key] = value
        return copy

    def to_dict(self) -> dict[str, Any]:
        """Return the tables as the program sees them, with paths that hold from anywhere."""
        tree = deepcopy(self._tree)
        start = tree.get("initial", {})
        directory = Path() if self.path is None else self.path.parent
        for key in ("warped", "field"):
            if isinstance(start, dict) and isinstance(start.get(key), str):
                start[key] = str(directory.absolute() / start[key])
        regions = tree.get("potential", [])
        places = [start, tree.get("inflow"), *(regions if isinstance(regions, list) else [])]
        for place in places:
            table = place.get("table") if isinstance(place, dict) else None
            if isinstance(table, dict) and isinstance(table.get("file"), str):
                table["file"] = str(directory.absolute() / table["file"])
        return tree

    def to_toml(self) -> str:
        """Return the text of a case file."""
        return "\n".join(table_lines("", self.to_dict())) + "\n"

    def save(self, path: StrPath) -> Path:
        """Write a case file; returns its path."""
        Path(path).write_text(self.to_toml(), encoding="utf-8")
        return Path(path)

    def settings(self) -> list[str]:
        """Return what replaces values of the file, as ``KEY=VALUE``."""
        return [f"{key}={toml(value)}" for key, value in self._settings.items()]

    @contextmanager
    def arguments(self, directory: Path | None = None) -> Iterator[list[str]]:
        """Give the words by which the program takes this case.

        A file is named as it is, so that messages point into it, with a ``--set`` for every value
        that was replaced. A case that was made here, lacks keys of its file, or has long values is
        written to a file ``case.toml``. Of a run into `directory` this is kept there, unless the
        run is refused; otherwise it is removed afterwards, and messages name it without its place.
        """
        settings = self.settings()
        longest = max(map(len, settings), default=0)
        if self.path is not None and longest <= LONGEST_ARGUMENT and not self._removed:
            yield [str(self.path), *itertools.chain(*(["--set", s] for s in settings))]
            if directory is not None and is_written(directory / FILE):
                (directory / FILE).unlink()  # of another run, whose results this one replaced
            return
        words = []
        if self.path is not None and "title" not in self._tree:
            # By default the title is the name of the file.
            words = ["--set", f"title={toml(self.path.name)}"]
        with written(self.to_toml(), directory) as path:
            yield [str(path), *words]

    def faces(self, axis: str) -> np.ndarray:
        """Return the faces of the cells along an axis (`x`, …, `vz`; in one dimension also `v`).

        Returns
        -------
        ndarray, shape (cells + 1,)

        Raises
        ------
        KeyError
            For an axis that the case does not have.
        """
        number, kind = axis_place(axis)
        if number >= len(self["axis"]):
            raise KeyError(f"{axis}: the case has {len(self['axis'])} dimensions of space")
        table = self[f"axis.{number}.{kind}"]
        lower, upper = table["lower"], table["upper"]
        if isinstance(lower, str) or isinstance(upper, str):
            # Formulas of constants, of which the program knows the values.
            with self.arguments() as words:
                axes = json.loads(call(["check", *words, "--json"]))["axes"]
            found = axes[number + (len(axes) // 2 if kind == "v" else 0)]
            lower, upper = found["lower"], found["upper"]
        # The program takes a whole number as a float, too.
        return np.linspace(lower, upper, int(table["cells"]) + 1)

    def grid(self) -> dict[str, np.ndarray]:
        """Return the cell centres of all axes by name, ``x, …, vx, …``: coordinates for xarray.

        Raises
        ------
        ValueError
            For a degree above 0, whose nodes a result has: ``open_result(…).coords``.
        """
        axes = self["axis"]
        degrees = [self._tree.get("scheme", {}).get("degree", 0)]
        degrees += [table.get("degree", 0) for axis in axes for table in (axis["x"], axis["v"])]
        if any(degrees):
            raise ValueError(
                "scheme.degree is above 0: its nodes are the coordinates of a result of this grid"
            )
        names = [*SPACE[: len(axes)], *(f"v{name}" for name in SPACE[: len(axes)])]
        faces = {name: self.faces(name) for name in names}
        return {name: 0.5 * (ends[1:] + ends[:-1]) for name, ends in faces.items()}


@contextmanager
def written(text: str, directory: Path | None) -> Iterator[Path]:
    """Give a file with the text of a case: in the directory of a run, or one that is removed.

    What the directory held before is there again if the run is refused. A file of another origin
    there is not touched.
    """
    path = None if directory is None else directory / FILE
    if path is None or (path.exists() and not is_written(path)):
        with tempfile.TemporaryDirectory(prefix=TEMPORARY) as place:
            path = Path(place) / FILE
            path.write_text(text, encoding="utf-8")
            yield path
        return
    before = path.read_bytes() if path.exists() else None
    created = [place for place in path.parents if not place.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    if before != (text + MARK).encode():
        path.write_text(text + MARK, encoding="utf-8")
    try:
        yield path
    except Exception as error:
        # Whatever else the program says, it has begun.
        if isinstance(error, CaseError) or not isinstance(error, PhasewarpError):
            if before is None:
                path.unlink()
            else:
                path.write_bytes(before)
            with suppress(OSError):
                for made in created:
                    made.rmdir()
            if error.args and isinstance(error.args[0], str):
                error.args = (error.args[0].replace(str(path), FILE), *error.args[1:])
        raise


def is_written(path: Path) -> bool:
    """Return whether a file is one that :func:`written` left in the directory of a run."""
    return path.is_file() and path.read_bytes().endswith(MARK.encode())


def index_of(place: Any, part: str) -> int | str:
    """Return a part of a dotted key as an index into a table or a list; else `LookupError`."""
    if isinstance(place, dict):
        return part
    if isinstance(place, list) and part.isdecimal():
        return int(part)
    raise LookupError(part)


def axis_place(name: str) -> tuple[int, str]:
    """Return number and kind (`x` or `v`) of the table of an axis `x`, …, `vz`."""
    kind, letter = ("v", name[1:] or "x") if name.startswith("v") else ("x", name)
    if letter not in SPACE:
        raise KeyError(f"{name}: no axis; there are x, y, z, vx, vy, vz")
    return SPACE.index(letter), kind


def potential_table(values: ArrayLike, *axes: ArrayLike) -> list[dict[str, str]]:
    """Return `[[potential]]` for a potential given by an array.

    As many values as points along each axis: `V` is linear between the points (multilinear in more
    dimensions). One value less along each axis: `V` is constant between the points. A point that
    occurs twice is a jump between its two values. `V` of the outermost pieces goes on beyond them.

    Take points on the faces of the grid (:meth:`Case.faces`). The program moves the others to the
    nearest face, and warns.

    Parameters
    ----------
    values
        `V`, of shape ``(N_x, …)`` or ``(N_x - 1, …)``.
    *axes
        Points along x, y, z, each ascending, of shape ``(N_x,)``, ….

    Examples
    --------
    >>> x = case.faces("x")
    >>> case["potential"] = potential_table(0.1 * x**2, x)
    """
    points = [np.asarray(axis, dtype=float) for axis in axes]
    v = np.asarray(values, dtype=float)
    shape = tuple(len(p) for p in points)
    if not 1 <= len(points) <= len(SPACE) or min(shape, default=0) < 2:
        raise ValueError("one to three axes of at least two points each expected")
    if any(np.any(np.diff(p) < 0) for p in points):
        raise ValueError("points of an axis must ascend")
    constant = v.shape == tuple(n - 1 for n in shape)
    if not constant and v.shape != shape:
        raise ValueError(f"values of shape {v.shape}; the axes have {shape} points")
    if not np.all(np.isfinite(v)):
        raise ValueError("values must be finite")
    pieces = [[i for i in range(len(p) - 1) if p[i] < p[i + 1]] for p in points]
    lists = [p.tolist() for p in points]
    regions: list[dict[str, str]] = []
    for piece in itertools.product(*pieces):
        # Lexicographic order: the first region that lies above a point in all axes has it.
        upper = [
            f"{name} < {p[i + 1]!r}"
            for name, p, i, all_of in zip(SPACE, lists, piece, pieces, strict=False)
            if i != all_of[-1]
        ]
        formula = repr(float(v[piece])) if constant else multilinear(v, points, piece)
        if len(points) == 1 and regions and regions[-1]["value"] == formula:
            regions.pop()  # the region of this piece has that one, too
        regions.append(
            {"where": " && ".join(upper), "value": formula} if upper else {"value": formula}
        )
    return regions


def multilinear(v: np.ndarray, points: Sequence[np.ndarray], piece: tuple[int, ...]) -> str:
    """Return the multilinear interpolant on a box as a formula, ``c + c*(x - x0) + …``."""
    corner = v[tuple(slice(i, i + 2) for i in piece)]
    factors = []
    for a, (p, i) in enumerate(zip(points, piece, strict=True)):
        low, high = (corner.take(k, axis=a) for k in (0, 1))
        corner = np.stack([low, (high - low) / (p[i + 1] - p[i])], axis=a)
        factors.append(f"({SPACE[a]} - ({float(p[i])!r}))")
    terms = []
    for powers in itertools.product((0, 1), repeat=len(points)):
        coefficient = float(corner[powers])
        if coefficient != 0.0:
            chosen = [f for f, power in zip(factors, powers, strict=True) if power]
            terms.append("*".join([f"({coefficient!r})", *chosen]))
    return " + ".join(terms) or "0"


def write_warped(w: xr.DataArray, path: StrPath) -> Path:
    """Write a warped field `w(0, x, v, p)` that a run can start from; returns the absolute path.

    This is how NumPy arrays for `f(0)` and `g(p)` reach the program. The field is
    ``e^p w`` read at `solver.warp.recovery`; docs/usage.md, "The warped field", says what such a
    run can do.

    Parameters
    ----------
    w
        Dimensions ``x, …, vx, …, p``, with coordinates: the grid of the case (:meth:`Case.grid`),
        and equally spaced points in p, an even number of them, ``p_j = L + jP/N_p``.
    path
        The HDF5 file.

    Examples
    --------
    >>> f = xr.DataArray(array, coords=case.grid())
    >>> g = xr.DataArray(np.exp(-np.abs(p)), coords={"p": p})
    >>> case["initial"] = {"warped": write_warped(f * g, "start.h5")}
    """
    count = (w.ndim - 1) // 2
    names = [*SPACE[:count], *(f"v{name}" for name in SPACE[:count]), "p"]
    missing = set(names) ^ set(map(str, w.dims)) | {n for n in names if n not in w.coords}
    if missing:
        raise ValueError(
            f"dimensions {w.dims}: {', '.join(names)} expected, each with a coordinate"
        )
    path = Path(path).absolute()
    with h5py.File(path, "w") as file:
        data = file.create_dataset("w", data=w.transpose(*names).values.astype("<f8"))
        for number, name in enumerate(names):
            scale = file.create_dataset(name, data=w[name].values.astype("<f8"))
            file[f"axis/{name}"] = scale
            scale.make_scale(name)
            data.dims[number].attach_scale(scale)
    return path


def write_table(f: xr.DataArray, path: StrPath) -> dict[str, Any]:
    """Write an array for `f(0, x, v)`, `V(x)` or the inflow that a run can take.

    Returns what `initial.table`, `potential.N.table` or `inflow.table` is. docs/usage.md, "Tables
    in files", says what the function is between the points and beyond the ends of the axes.

    Parameters
    ----------
    f
        Dimensions among ``x, y, z, vx, vy, vz, t`` (in one dimension also ``v``), each with a
        coordinate that ascends: any points, not only those of the grid of the case.
    path
        The HDF5 file.

    Examples
    --------
    >>> f = xr.DataArray(array, coords={"x": x, "vx": v})
    >>> case["initial"] = {"table": write_table(f, "f0.h5")}
    >>> v = xr.DataArray(0.1 * x**2, coords={"x": x})
    >>> case["potential"] = [{"table": write_table(v, "V.h5"), "interpolation": "linear"}]
    """
    if not isinstance(f, xr.DataArray):
        raise TypeError(f"{type(f).__name__}: an xarray.DataArray with coordinates expected")
    if Path(path).suffix.lower() == ".csv":
        raise ValueError(f"{path}: this writes HDF5, which the program takes a .csv not to be")
    known = [*SPACE, *(f"v{name}" for name in SPACE), "t"]
    # As in a case: the velocity of one dimension.
    names = [str(name) for name in f.dims]
    plane = {"y", "z", "vx", "vy", "vz"}.intersection(names)
    wrong = set(names).difference(known if plane else [*known, "v"])
    if not names or wrong or any(name not in f.coords for name in names):
        hint = "; v is vx there" if wrong == {"v"} else ""
        said = f"some of {', '.join(known)}, each with a coordinate{hint}"
        raise ValueError(f"dimensions {f.dims}: {said}")
    if not np.isfinite(f.values).all():
        raise ValueError("a value is not finite")
    if any(not (np.diff(f[name].values) > 0).all() for name in names):
        raise ValueError("a coordinate does not ascend")
    path = Path(path).absolute()
    with h5py.File(path, "w") as file:
        file.create_dataset("f", data=f.values.astype("<f8"))
        for name in names:
            file.create_dataset(f"axis/{name}", data=f[name].values.astype("<f8"))
    return {"file": str(path), "dataset": "f", "axes": names}


def refuse_arrays(key: str, value: Any) -> None:
    """Raise `ValueError` where a formula has its place, and `value` has an array there."""
    if isinstance(value, Mapping):
        for inner, item in value.items():
            refuse_arrays(f"{key}.{inner}", item)
    elif isinstance(value, list | tuple) and any(isinstance(item, Mapping) for item in value):
        for number, item in enumerate(value):
            refuse_arrays(f"{key}.{number}", item)
    elif isinstance(value, list | tuple | np.ndarray | xr.DataArray) and FORMULA.fullmatch(key):
        table = key.rpartition(".")[0]
        also = ", potential_table makes formulas of one" if table.startswith("potential") else ""
        raise ValueError(
            f'{key}: a formula expected, not an array; write_table writes an array for "{table}.'
            f'table"{also}'
        )


def plain(value: Any) -> Any:
    """Return `value` as TOML has it: NumPy's numbers and arrays as Python's, paths as absolute."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, os.PathLike):
        return str(Path(value).absolute())
    if not isinstance(value, str | bool | int | float):
        raise TypeError(f"{value!r}: a case holds numbers, texts, lists and tables")
    return value


def toml(value: Any) -> str:
    """Return a value in TOML, on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{toml_key(k)} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON's escapes are TOML's, except for one character that JSON leaves as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    return repr(value)


def toml_key(key: str) -> str:
    """Return a key in TOML, quoted if it must be."""
    return key if BARE_KEY.fullmatch(key) else toml(key)


def table_lines(name: str, table: Mapping[str, Any]) -> Iterator[str]:
    """Give the lines of a table: its values, then the tables below it."""

    def is_tables(value: Any) -> bool:
        return isinstance(value, list) and bool(value) and all(isinstance(i, dict) for i in value)

    below = {k: v for k, v in table.items() if isinstance(v, dict) or (not name and is_tables(v))}
    yield from (f"{toml_key(k)} = {toml(v)}" for k, v in table.items() if k not in below)
    for key, value in below.items():
        path = f"{name}.{toml_key(key)}" if name else toml_key(key)
        if isinstance(value, dict):
            yield from ("", f"[{path}]", *table_lines(path, value))
            continue
        for item in value:
            yield from ("", f"[[{path}]]")
            yield from (f"{toml_key(k)} = {toml(v)}" for k, v in item.items())
