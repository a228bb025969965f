"""Results as labelled arrays: `result.h5` as an xarray Dataset, `summary.json` as a dict."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from xarray.backends import BackendArray, BackendEntrypoint
from xarray.core import indexing

from phasewarp.program import StrPath, call

SPACE = ("x", "y", "z")
#: What is said of other files.
NO_RESULT = (
    "not a file that a run writes its fields to; the directory of a run expected, its result.h5, "
    "or a warped field"
)
#: Groups of the file that hold copies or no arrays.
LEFT_OUT = ("axis", "xdmf", "timings")


@dataclass(frozen=True)
class Result:
    """A finished run: the directory that it wrote, as an absolute path."""

    directory: Path

    def __init__(self, directory: StrPath) -> None:
        # It holds after a change of the working directory, too.
        object.__setattr__(self, "directory", Path(directory).absolute())

    @cached_property
    def summary(self) -> dict[str, Any]:
        """All numbers of the run (`summary.json`); `None` where one is not known."""
        found: dict[str, Any] = json.loads((self.directory / "summary.json").read_text("utf-8"))
        return found

    def open(self, **options: Any) -> xr.Dataset:
        """Open the fields and moments; see :func:`open_result`."""
        return open_result(self.directory, **options)

    def plot(self, *, program: StrPath | None = None) -> list[Path]:
        """Draw the run; returns the figures, as PNG, in its directory ``plots``."""
        call(["plot", self.directory], program=program)
        return sorted((self.directory / "plots").glob("*.png"))

    def report(self, *, program: StrPath | None = None) -> Path:
        """Write one HTML page with figures and all numbers; returns its path."""
        call(["report", self.directory], program=program)
        return self.directory / "report.html"


def open_result(path: StrPath, **options: Any) -> xr.Dataset:
    """Open a result as a labelled Dataset; values are read when they are asked for.

    Dimensions and coordinates are those of the case: ``x, y, z, vx, vy, vz`` (cell centres; of a
    degree above 0 the nodes), ``component`` of vectors (``x``, …), ``p`` of a warped field. Every
    axis has quadrature weights (cell widths, of a degree above 0 those of the nodes) as a
    coordinate ``weights_x``, …, so that integrals are sums: the density is
    ``(f * weights_vx).sum("vx")``.

    Moments of a run with output times have a dimension ``time``. Fields have a dimension
    ``field_time`` where they were written more than once. The end of the run is the last of both.
    Other groups of the file become variables ``group_name``, as ``plateau_distance``.

    Attributes follow the CF conventions (``units``, ``long_name``, ``axis``, ``title``,
    ``source``, ``history``, ``references``). ``units`` is always ``"1"``: the equation has none.
    Beside `result.h5`, the numbers of `summary.json` are attributes, too.

    Parameters
    ----------
    path
        The directory of a run, its `result.h5`, or a warped field, as `warped_f.h5`.
    **options
        As for :func:`xarray.open_dataset`, for example ``chunks={}`` for Dask. Use ``.load()`` to
        read everything at once.
    """
    place = file_of(path)
    if not place.is_file():
        raise FileNotFoundError(f"{place.absolute()}: no result of phasewarp")
    return xr.open_dataset(place, engine=Backend, **options)


def file_of(path: StrPath) -> Path:
    """Return the result in the directory of a run; of a file the file itself."""
    place = Path(path)
    return place / "result.h5" if place.is_dir() else place


class Backend(BackendEntrypoint):
    """Lets ``xarray.open_dataset(path, engine="phasewarp")`` read results."""

    description = "Results of phasewarp"

    def open_dataset(  # type: ignore[override]
        self,
        filename_or_obj: StrPath,
        *,
        drop_variables: str | Iterable[str] | None = None,
    ) -> xr.Dataset:
        """Open a result; see :func:`open_result`."""
        path = file_of(filename_or_obj)
        if not h5py.is_hdf5(path):
            raise OSError(f"{path}: {NO_RESULT}")
        dropped = {drop_variables} if isinstance(drop_variables, str) else set(drop_variables or ())
        with h5py.File(path) as file:
            if "time" not in file.attrs or "case_file" not in file.attrs:
                raise OSError(f"{path}: {NO_RESULT}")
            variables = {**fields(file, path), **earlier(file, path)}
            coordinates = axes(file)
            coordinates.update(times(file))
            attributes = provenance(file)
        used = {dim for variable in variables.values() for dim in variable.dims}
        used |= {"time", "field_time"}
        coordinates = {n: c for n, c in coordinates.items() if used.issuperset(c.dims)}
        summary = path.parent / "summary.json"
        if path.name == "result.h5" and summary.is_file():
            attributes.update(numbers(json.loads(summary.read_text("utf-8"))))
        kept = {name: v for name, v in variables.items() if name not in dropped}
        return xr.Dataset(kept, coordinates, attributes)


class Frames(BackendArray):
    """Datasets of one file, read where indices ask for it; no file stays open.

    One dataset is read as it is. With `last`, the first dataset has a leading axis of times, and
    the second follows it as the last time.
    """

    def __init__(self, path: Path, first: h5py.Dataset, last: h5py.Dataset | None = None) -> None:
        self.path = path
        self.name = first.name
        self.last = None if last is None else last.name
        self.dtype = first.dtype
        self.shape = first.shape
        if last is not None:
            self.shape = (first.shape[0] + 1, *first.shape[1:])

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        support = indexing.IndexingSupport.BASIC
        found: np.ndarray = indexing.explicit_indexing_adapter(key, self.shape, support, self.read)
        return found

    def read(self, key: tuple[int | slice, ...]) -> np.ndarray:
        """Read by whole numbers and slices."""
        with h5py.File(self.path) as file:
            if self.last is None:
                return np.asarray(file[self.name][key])
            end = self.shape[0] - 1
            place, rest = key[0], key[1:]

            def frame(number: int) -> np.ndarray:
                if number == end:
                    return np.asarray(file[self.last][rest])
                return np.asarray(file[self.name][(number, *rest)])

            if isinstance(place, slice):
                frames = [frame(number) for number in range(*place.indices(end + 1))]
                return np.stack(frames) if frames else np.empty((0, *frame(end).shape))
            return frame(int(place) % (end + 1))


def variable(
    path: Path,
    data: h5py.Dataset,
    last: h5py.Dataset | None = None,
    dims: tuple[str, ...] | None = None,
) -> xr.Variable:
    """Return a dataset as a variable that is read when it is asked for."""
    array = indexing.LazilyIndexedArray(Frames(path, data, last))
    return xr.Variable(dims or dimensions(data), array, described(data))


def dimensions(data: h5py.Dataset) -> tuple[str, ...]:
    """Return the names of the dimension scales of a dataset."""
    return tuple(dim[0].name.rsplit("/", 1)[-1] for dim in data.dims if len(dim))


def described(data: h5py.Dataset) -> dict[str, Any]:
    """Return the attributes of a dataset that are for people and for CF."""
    wanted = ("long_name", "units", "degree", "elements", "lower", "upper")
    values = {name: data.attrs[name] for name in wanted if name in data.attrs}
    return {n: v.item() if isinstance(v, np.generic) else v for n, v in values.items()}


def fields(file: h5py.File, path: Path) -> dict[str, xr.Variable]:
    """Return all arrays at the end of the run."""
    found = {}
    scales = set(file["axis"]) if "axis" in file else set()
    for name, item in file.items():
        if isinstance(item, h5py.Dataset):
            if name not in scales and item.dtype.kind == "f":
                found[name] = variable(path, item)
        elif name not in (*LEFT_OUT, "history"):
            for inner, data in item.items():
                # Columns of a table without a dimension scale share one, called as the table.
                dims = dimensions(data) or (name,)
                found[f"{name}_{inner}"] = variable(path, data, dims=dims)
    return found


def earlier(file: h5py.File, path: Path) -> dict[str, xr.Variable]:
    """Return what has output times: moments, the end among them, and fields, then the end."""
    found = {}
    for name, data in file.get("history", {}).items():
        dims = dimensions(data)
        last = file[name] if dims[0] == "field_time" and lacks_end(file) else None
        found[name] = variable(path, data, last, dims)
    return found


def lacks_end(file: h5py.File) -> bool:
    """Whether the end of the run is not among the times of the fields."""
    return bool(file["axis/field_time"][-1] < file.attrs["time"])


def times(file: h5py.File) -> dict[str, xr.Variable]:
    """Return `time` and `field_time`: axes where there are several, else the time of the end."""
    end = float(file.attrs["time"])
    about = {"long_name": "time", "units": "1"}
    found = {"time": xr.Variable((), end, about)}
    if "axis/time" in file:
        found["time"] = xr.Variable("time", file["axis/time"][()], {**about, "axis": "T"})
        found["field_time"] = xr.Variable((), end, {**about, "long_name": "time of the fields"})
    if "axis/field_time" in file:
        values = file["axis/field_time"][()]
        if lacks_end(file):
            values = np.append(values, end)
        about = {"long_name": "time of the fields", "units": "1", "axis": "T"}
        found["field_time"] = xr.Variable("field_time", values, about)
    return found


def axes(file: h5py.File) -> dict[str, xr.Variable]:
    """Return the coordinates of phase space with their weights, and those of other dimensions."""
    found = {}
    for name, data in file.get("axis", {}).items():
        if name in ("time", "field_time") or name.startswith("weights_"):
            continue
        values, about = data[()], described(data)
        phase = re.fullmatch(r"(element_)?(v?)([xyz])", name)
        if phase:
            element, velocity, letter = phase.groups()
            what = "velocity" if velocity else "position"
            about["long_name"] = f"{what} along {letter}" + (", of elements" if element else "")
            if not velocity and not element:
                about["axis"] = letter.upper()
            if not element:
                found[f"weights_{name}"] = weights(file, name)
        elif name == "component":
            values, about = np.array(SPACE[: len(values)]), {"long_name": "component of a vector"}
        elif name == "p":
            about["long_name"] = "auxiliary variable of the warped phase transformation"
        found[name] = xr.Variable(name, values, about)
    return found


def weights(file: h5py.File, name: str) -> xr.Variable:
    """Return the quadrature weights of an axis; of degree 0 the width of its cells."""
    about = {"long_name": f"quadrature weights of {name}", "units": "1"}
    if f"axis/weights_{name}" in file:
        return xr.Variable(name, file[f"axis/weights_{name}"][()], about)
    axis = file[f"axis/{name}"]
    width = (axis.attrs["upper"] - axis.attrs["lower"]) / len(axis)
    return xr.Variable(name, np.full(len(axis), width), about)


def provenance(file: h5py.File) -> dict[str, Any]:
    """Return the attributes of the file as CF names them, and the others as they are."""
    given = {k: v.item() if isinstance(v, np.generic) else v for k, v in file.attrs.items()}
    attributes = {
        "Conventions": "CF-1.11",
        "title": given.pop("title", ""),
        "references": given.pop("reference", ""),
        "source": f"{given.pop('program', 'phasewarp')} ({given.pop('git', 'unknown')})",
        "history": f"{given.pop('date', '')}: {given.pop('command', '')}",
    }
    return {**attributes, **given}


def numbers(summary: dict[str, Any]) -> dict[str, Any]:
    """Return the entries of a summary that an attribute can hold: numbers and texts."""
    found: dict[str, int | float | str] = {}
    for name, value in summary.items():
        if isinstance(value, bool):
            found[name] = int(value)
        elif isinstance(value, int | float | str) and name != "title":
            found[name] = value
    return found


def entry(summary: dict[str, Any], key: str) -> Any:
    """Return the entry of a summary by a dotted key, as ``accuracy.grid``; `None` if unknown."""
    value: Any = summary
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return value
