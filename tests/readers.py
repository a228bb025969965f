"""Opens the results of a run as a user would, and checks values, not only that files open.

    python tests/readers.py DIR [DIR...]
        what went wrong as an exception, otherwise one line a directory
    python tests/readers.py --packages
        nothing, if every package is there

The directories hold runs of cases with the exact solution f = 1 + x + 10 v in one dimension,
1 + x + 10 y + 100 vx + 1000 vy in two and so on, or with measure-valued data.
"""

import json
import pathlib
import sys

import h5netcdf  # noqa: F401  (the engine of xarray below)
import h5py
import meshio
import numpy as np
import xarray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOXdmf2 import vtkXdmfReader

SPACE, VELOCITY = ["x", "y", "z"], ["vx", "vy", "vz"]


def checksum(data):
    """The checksum of docs/usage.md, once more."""
    if data.dtype.kind == "S":
        bits = np.frombuffer(data.tobytes(), dtype=np.uint8).astype(np.uint64)
    else:
        bits = np.ascontiguousarray(data, dtype="<f8").reshape(-1).view(np.uint64)
    with np.errstate(over="ignore"):
        index = np.arange(1, bits.size + 1, dtype=np.uint64)
        z = bits + index * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return (z ^ (z >> np.uint64(31))).sum(dtype=np.uint64)


def same(found, expected, what, by=0.0):
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape, f"{what}: shape {found.shape}, {expected.shape} expected"
    both = np.isnan(found) & np.isnan(expected)
    worst = np.max(np.where(both, 0.0, np.abs(found - expected)), initial=0.0)
    assert worst <= by, f"{what}: differs by {worst}, {by} allowed"


def with_h5py(path):
    """Attributes, checksums, dimension scales, and the moments from f."""
    with h5py.File(path) as file:
        for name, kind in [
            ("program", str),
            ("git", str),
            ("rustc", str),
            ("mpi", str),
            ("hdf5", str),
            ("command", str),
            ("date", str),
            ("ranks", np.integer),
            ("time", float),
        ]:
            assert isinstance(file.attrs[name], kind), f"{name}: {file.attrs[name]!r}"
        assert file.attrs["date"].endswith("Z") and file.attrs["program"].startswith("phasewarp ")
        assert "[[axis]]" in file["case"][()].decode() and file["plan"][()].decode().startswith("{")
        numbers = []

        def visit(name, item):
            if isinstance(item, h5py.Dataset):
                assert item.attrs["checksum"] == checksum(item[()]), f"checksum of {name}"
                numbers.append(name)

        file.visititems(visit)
        assert len(numbers) >= 10, numbers
        n = sum(name in file for name in SPACE)
        names = SPACE[:n] + VELOCITY[:n]
        main = file["f" if "f" in file else "phi"]
        assert main.shape == tuple(len(file[name]) for name in names)
        assert [d[0].name for d in main.dims] == [f"/axis/{a}" for a in names] or [
            d[0].name for d in main.dims
        ] == [f"/{a}" for a in names]
        if "f" in file:
            widths = np.prod([file[v][1] - file[v][0] for v in VELOCITY[:n]])
            density = main[()].sum(axis=tuple(range(n, 2 * n))) * widths
            same(file["density"], density, "density from f", 1e-11 * np.abs(density).max())
        return n, "f" in file


def with_xarray(path, n, density):
    """Coordinates by name, with units, and the exact solution at known places."""
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        names = SPACE[:n] + VELOCITY[:n]
        main = data["f" if density else "phi"]
        assert main.dims == tuple(names), main.dims
        for name in names:
            assert data[name].attrs["units"] == "1" and name in main.coords, name
        assert main.attrs["units"] == "1" and main.attrs["long_name"]
        assert data["density"].dims == tuple(SPACE[:n])
        assert data["velocity"].dims == ("component", *SPACE[:n])
        if density:
            weights = {name: 10.0**k for k, name in enumerate(names)}
            expected = 1.0 + sum(w * data[name] for name, w in weights.items())
            same(data["exact"], expected, "exact", 1e-12 * 10.0 ** (2 * n))
            place = {
                name: float(data[name][(k + 1) % data.sizes[name]]) for k, name in enumerate(names)
            }
            value = float(data["exact"].sel(place))
            same(
                value,
                1.0 + sum(weights[name] * place[name] for name in names),
                "exact at one cell",
                1e-12 * 10.0 ** (2 * n),
            )


def history(path, n, density):
    """Moments and fields over time by name, if any; the last moments are those of the end."""
    with h5py.File(path) as file:
        if "history" not in file:
            return False
    with xarray.open_datatree(path, engine="h5netcdf") as tree:
        end, data = tree.to_dataset(), tree["history"].to_dataset()
        assert data["density"].dims == ("time", *SPACE[:n]), data["density"].dims
        assert data["velocity"].dims == ("time", "component", *SPACE[:n]), data["velocity"].dims
        field = data["f" if density else "phi"]
        assert field.dims == ("field_time", *SPACE[:n], *VELOCITY[:n]), field.dims
        times = data["density"].coords["time"].values
        assert np.all(np.diff(times) > 0) and times[-1] == end.attrs["time"], times
        assert set(field.coords["field_time"].values) < set(times)
        same(data["density"].sel(time=times[-1]), end["density"], "density at the end")
        widths = np.prod([float(end[a][1] - end[a][0]) for a in SPACE[:n]])
        same(data["mass"], data["density"].sum(SPACE[:n]) * widths, "mass", 1e-12)
        if density:
            widths = np.prod([float(end[v][1] - end[v][0]) for v in VELOCITY[:n]])
            at = data["density"].sel(time=field.coords["field_time"].values)
            same(at, field.sum(VELOCITY[:n]) * widths, "density from f", 1e-11 * float(at.max()))
    return True


def warped(directory, n):
    """Whole warped fields by name, where there are some, and their number.

    e^p w, read at a point of the file, is the field at that time.
    """
    paths = sorted(directory.glob("warped_f*.h5"))
    for path in paths:
        with h5py.File(path) as file, h5py.File(directory / "result.h5") as result:
            for name in ["w", "case", "plan", *SPACE[:n], *VELOCITY[:n], "p"]:
                assert file[name].attrs["checksum"] == checksum(file[name][()]), (
                    f"checksum of {name}"
                )
            point = json.loads(file["plan"][()])["warp"]["readings"][0]["point"]
            time = file.attrs["time"]
            if time == result.attrs["time"]:
                expected = result["f"][()]
            else:
                place = int(np.argmin(np.abs(result["field_time"][()] - time)))
                assert result["field_time"][place] == time, time
                expected = result["history/f"][place]
        with xarray.open_dataset(path, engine="h5netcdf") as data:
            assert data["w"].dims == (*SPACE[:n], *VELOCITY[:n], "p"), data["w"].dims
            assert "p" in data["w"].coords and data["w"].attrs["units"] == "1"
            at = data["w"].sel(p=point, method="bfill")
            found = np.exp(float(at["p"])) * at.values
            same(found, expected, f"e^p w of {path.name}", 1e-5 * np.abs(expected).max())
    return len(paths)


def blocks(block):
    if hasattr(block, "GetNumberOfBlocks"):
        for k in range(block.GetNumberOfBlocks()):
            yield from blocks(block.GetBlock(k))
    else:
        yield block


def with_vtk(directory, n, density):
    """Every field of fields.xdmf at every time and cell against result.h5.

    VTK places the values; the cell of result.h5 is the one with that centre.
    """
    reader = vtkXdmfReader()
    reader.SetFileName(str((directory / "fields.xdmf").absolute()))
    reader.Update()
    steps = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    with h5py.File(directory / "result.h5") as file:
        times = file["time"][()] if "history" in file else [file.attrs["time"]]
        field_times = list(file["field_time"][()]) if "field_time" in file else []
        same(steps, times, "time")
        fields = ["f"] if density else ["phi", *[f"psi_{a}" for a in SPACE[:n]]]
        for k, time in enumerate(times):
            reader.UpdateTimeStep(time)
            at_end = k + 1 == len(times)
            with_fields = at_end or time in field_times
            expected = {f"space/{m}" for m in moments(file)}
            shown = fields + (["exact"] if density and at_end else [])
            expected |= {f"plane_{a}/{f}" for a in SPACE[:n] for f in shown if with_fields}
            found = at_a_time(reader, file, n, lambda name, time=time: stored(file, name, time))
            assert found == expected, (time, found ^ expected)
    return len(times)


def moments(file):
    """What is shown over space at every time."""
    names = ["density", "momentum", "velocity"]
    exact = [f"{name}_exact" for name in names if f"{name}_exact" in file]
    return {*names, *exact, "potential"}


def stored(file, name, time):
    """What result.h5 has by a name at a time."""
    base = name.split("_")[0] if name.startswith("psi_") else name
    if base == "potential" or time == file.attrs["time"]:
        return file[base]
    axis = "field_time" if base in ("f", "phi", "psi") else "time"
    return file[f"history/{base}"][list(file[axis][()]).index(time)]


def by_meshio(path):
    """Time, corners of the cells and their values, time by time."""
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        points, cells = reader.read_points_cells()
        for k in range(reader.num_steps):
            time, _, data = reader.read_data(k)
            # Refuses values of other numbers than the cells.
            mesh = meshio.Mesh(points, cells, cell_data=data)
            assert [block.type for block in mesh.cells] in (["quad"], ["hexahedron"]), mesh.cells
            values = {name: blocks[0] for name, blocks in mesh.cell_data.items()}
            yield time, mesh.points[mesh.cells[0].data], values


def by_vtk(path):
    """The same."""
    reader = vtkXdmfReader()
    reader.SetFileName(str(path))
    reader.Update()
    steps = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    for time in steps or [0.0]:
        reader.UpdateTimeStep(time)
        (grid,) = blocks(reader.GetOutputDataObject(0))
        points = vtk_to_numpy(grid.GetPoints().GetData())
        count = grid.GetNumberOfCells()
        corners = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(count, -1)
        arrays = grid.GetCellData()
        found = range(arrays.GetNumberOfArrays())
        values = {arrays.GetArrayName(k): vtk_to_numpy(arrays.GetArray(k)) for k in found}
        yield time, points[corners], values


def as_lists(directory, n, density):
    """Every file of a grid at every time and cell, by meshio and by VTK, against result.h5.

    They place the cells; the cell of result.h5 is the one with that centre.
    """
    fields = ["f"] if density else ["phi", *[f"psi_{a}" for a in SPACE[:n]]]
    with h5py.File(directory / "result.h5") as file:
        end = file.attrs["time"]
        times = list(file["time"][()]) if "history" in file else [end]
        field_times = [*(file["field_time"][()] if "field_time" in file else []), end]
        middle = {a: len(file[a]) // 2 for a in SPACE[:n] + VELOCITY[:n]}
        for grid in [*[f"plane_{a}" for a in SPACE[:n]], "space"]:
            axes = SPACE[:n] if grid == "space" else [grid[-1], f"v{grid[-1]}"]
            path = (directory / f"{grid}.xdmf").absolute()
            for read in (by_meshio, by_vtk):
                steps = list(read(path))
                expected = times if grid == "space" else field_times
                same([step[0] for step in steps], expected, f"{grid}: times")
                for time, corners, values in steps:
                    what = f"{grid} by {read.__name__} at {time}"
                    cells = places(file, axes, corners, what)
                    names = moments(file)
                    if grid != "space":
                        names = {*fields, *(["exact"] if density and time == end else [])}
                    assert set(values) == names, (what, set(values) ^ names)
                    for name, found in values.items():
                        data = stored(file, name, time)
                        if name.startswith("psi_"):
                            data = data[SPACE.index(name[-1])]
                        if grid != "space":
                            cut = [slice(None) if a in axes else m for a, m in middle.items()]
                            data = data[tuple(cut)]
                        data = np.asarray(data)
                        vector = data.ndim > len(axes)
                        data = np.moveaxis(data, 0, -1) if vector else data[..., None]
                        if vector and n > 1:
                            pad = np.zeros((*data.shape[:-1], 3 - n))
                            data = np.concatenate([data, pad], axis=-1)
                        same(found.reshape(len(corners), -1), data[cells], f"{what}: {name}")


def places(file, axes, corners, what):
    """The indices of the cells with these corners, of which each is there once."""
    widths = np.prod([file[a][1] - file[a][0] for a in axes])
    sizes = corners.max(axis=1) - corners.min(axis=1)
    same(np.prod(sizes[:, : len(axes)], axis=1), np.full(len(corners), widths), what, 1e-12)
    indices = []
    for k, axis in enumerate(axes):
        centres, found = file[axis][()], corners[:, :, k].mean(axis=1)
        index = np.abs(centres[:, None] - found).argmin(axis=0)
        same(found, centres[index], f"{what}: centres along {axis}", 1e-12)
        indices.append(index)
    shape = [len(file[a]) for a in axes]
    numbers = np.ravel_multi_index(indices, shape)
    assert sorted(numbers) == list(range(int(np.prod(shape)))), f"{what}: cells"
    return tuple(indices)


def at_a_time(reader, file, n, dataset):
    """The names of what VTK shows now; `dataset` gives what is stored by a name."""
    shown = set()
    centres = {name: file[name][()] for name in SPACE[:n] + VELOCITY[:n]}
    middle = {name: len(c) // 2 for name, c in centres.items()}
    for image in blocks(reader.GetOutputDataObject(0)):
        cells = [m - 1 for m in image.GetDimensions()]
        origin, spacing = image.GetOrigin(), image.GetSpacing()
        where = [origin[a] + spacing[a] * (np.arange(cells[a]) + 0.5) for a in range(3)]
        arrays = image.GetCellData()
        count = range(arrays.GetNumberOfArrays())
        values = {arrays.GetArrayName(k): vtk_to_numpy(arrays.GetArray(k)) for k in count}
        names = set(values)
        if names & {"density"}:
            grid, axes = "space", SPACE[:n]
        else:
            # A plane (x_a, v_a), identified by its axes: those of the tests differ.
            sizes = [[len(centres[SPACE[a]]), len(centres[VELOCITY[a]])] for a in range(n)]
            fits = [a for a in range(n) if cells[:2] == sizes[a]]
            assert len(fits) == 1, (cells, fits)
            grid, axes = f"plane_{SPACE[fits[0]]}", [SPACE[fits[0]], VELOCITY[fits[0]]]
        for a, axis in enumerate(axes):
            same(where[a], centres[axis], f"{grid}: centres along {axis}", 1e-12)
        for a in range(len(axes), 3):
            assert cells[a] == 1, f"{grid}: {cells}"
        if len(axes) < 3:
            same(where[2], [0.0], f"{grid}: place along the third axis", 1e-12)
        for name, found in values.items():
            shown.add(f"{grid}/{name}")
            # VTK counts along x first.
            found = found.reshape(*cells[::-1], -1)
            stored = dataset(name)
            if grid != "space":
                if name.startswith("psi_"):
                    stored = stored[SPACE.index(name[-1])]
                place = tuple(slice(None) if a in axes else middle[a] for a in centres)
                stored = stored[place][..., None]
            elif stored.ndim == n:
                stored = stored[()][..., None]
            else:
                stored = np.moveaxis(stored[()], 0, -1)
                if n > 1:
                    pad = np.zeros((*stored.shape[:-1], 3 - n))
                    stored = np.concatenate([stored, pad], axis=-1)
            found = found.reshape([*cells[::-1][3 - len(axes) :], -1])
            found = np.moveaxis(found, -1, 0)
            found = np.moveaxis(found.transpose(0, *range(len(axes), 0, -1)), 0, -1)
            same(found, stored, f"{grid}/{name}")
    return shown


for place in sys.argv[1:]:
    if place != "--packages":
        directory = pathlib.Path(place)
        dimension, is_density = with_h5py(directory / "result.h5")
        with_xarray(directory / "result.h5", dimension, is_density)
        early = ", history" if history(directory / "result.h5", dimension, is_density) else ""
        steps = with_vtk(directory, dimension, is_density)
        as_lists(directory, dimension, is_density)
        files = warped(directory, dimension)
        whole = f", {files} warped" if files else ""
        versions = (
            f"h5py {h5py.__version__}, xarray {xarray.__version__}, meshio {meshio.__version__}"
        )
        print(f"{place}: read by {versions}, VTK ({steps} times){early}{whole}")
