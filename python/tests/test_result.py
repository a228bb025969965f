"""Results as labelled arrays, compared with what h5py reads."""

from __future__ import annotations

import json
import pickle
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from conftest import CASES

import phasewarp as pw


def test_labels(small: pw.Case, tmp_path: Path) -> None:
    result = pw.run(small, tmp_path, ranks=2)
    data = result.open()
    assert data["f"].dims == data["exact"].dims == ("x", "vx")
    assert data["density"].dims == ("x",)
    assert data["velocity"].dims == ("component", "x")
    assert data["component"].values.tolist() == ["x"]
    assert float(data["time"]) == 1.0 and data["f"].coords["time"].ndim == 0
    np.testing.assert_allclose(data["x"], small.grid()["x"])
    assert data["f"].attrs["units"] == data["vx"].attrs["units"] == "1"
    assert data["x"].attrs["axis"] == "X" and "axis" not in data["vx"].attrs
    assert data["vx"].attrs["long_name"] == "velocity along x"
    assert data.attrs["Conventions"].startswith("CF-")
    assert data.attrs["title"] == "Step down (example 1)"
    assert data.attrs["source"].startswith("phasewarp ")
    assert " run " in data.attrs["history"]
    assert data.attrs["ranks"] == 2
    assert result.summary["version"] == version("phasewarp")
    assert data.attrs["error_estimate"] == result.summary["error_estimate"]
    with h5py.File(tmp_path / "result.h5") as file:
        np.testing.assert_array_equal(data["f"], file["f"][()])
        np.testing.assert_array_equal(data["velocity"], file["velocity"][()])


@pytest.mark.parametrize("degree", [0, 3])
def test_weights_integrate(small: pw.Case, tmp_path: Path, degree: int) -> None:
    small["scheme.degree"] = degree
    small["axis.0.x.cells"] = small["axis.0.v.cells"] = 8
    result = pw.run(small, tmp_path)
    data = result.open()
    density = (data["f"] * data["weights_vx"]).sum("vx")
    assert density.dims == data["density"].dims
    np.testing.assert_allclose(density, data["density"], rtol=1e-10, atol=1e-12)
    mass = float((data["density"] * data["weights_x"]).sum())
    assert mass == pytest.approx(result.summary["mass"], rel=1e-10)
    assert data.sizes["x"] == 8 * (degree + 1)
    assert float(data["weights_x"].sum()) == pytest.approx(3.0)
    if degree:
        assert data["x"].attrs["degree"] == degree and data["x"].attrs["elements"] == 8
        assert data["averages_f"].dims == ("element_x", "element_vx")
        # Nodes of elements are not equally spaced.
        assert np.ptp(np.diff(data["vx"])) > 0.01


def test_axes_that_were_left_out_have_their_width(tmp_path: Path) -> None:
    result = pw.run(CASES / "periodic2d.toml", tmp_path)
    data = result.open()
    assert data.sizes["y"] == 1
    density = (data["f"] * data["weights_vx"] * data["weights_vy"]).sum(["vx", "vy"])
    mass = float((density * data["weights_x"] * data["weights_y"]).sum())
    assert mass == pytest.approx(result.summary["mass"], rel=1e-10)


def test_output_times(small: pw.Case, tmp_path: Path) -> None:
    small["output"] = {"moments_every": 0.25, "field_times": [0.25, 0.6]}
    result = pw.run(small, tmp_path)
    data = result.open()
    times = data["time"].values
    assert {0.25, 0.5, 0.6, 0.75, 1.0} <= set(times) and times[-1] == 1.0
    assert np.all(np.diff(data["field_time"]) > 0) and data["field_time"][-1] == 1.0
    assert data["f"].dims == ("field_time", "x", "vx")
    assert data["density"].dims == ("time", "x")
    assert data["velocity"].dims == ("time", "component", "x")
    assert data["exact"].dims == ("x", "vx")
    for time in data["field_time"].values:
        density = (data["f"].sel(field_time=time) * data["weights_vx"]).sum("vx")
        np.testing.assert_allclose(density, data["density"].sel(time=time), atol=1e-12)
    np.testing.assert_allclose(
        (data["density"] * data["weights_x"]).sum("x"), data["mass"], rtol=1e-10
    )
    with h5py.File(tmp_path / "result.h5") as file:
        frames = {**dict(zip(file["axis/field_time"][()], file["history/f"][()], strict=True))}
        frames[1.0] = file["f"][()]
    for time, frame in frames.items():
        np.testing.assert_array_equal(data["f"].sel(field_time=time), frame)


def test_frames_are_read_by_any_index(small: pw.Case, tmp_path: Path) -> None:
    small["output.field_times"] = [0.25, 0.6]
    pw.run(small, tmp_path)
    whole = pw.open_result(tmp_path).load()["f"]
    lazy = pw.open_result(tmp_path)["f"]
    indices: list[dict[str, Any]] = [
        {"field_time": 0},
        {"field_time": -1, "x": slice(3, 9)},
        {"field_time": slice(1, None), "vx": -2},
        {"field_time": slice(None, None, -1)},
        {"field_time": [len(whole) - 1, 0], "x": [5, 1, 1]},
        {"field_time": slice(0, 0)},
        {"x": xr.DataArray([1, 2], dims="q"), "vx": xr.DataArray([3, 0], dims="q")},
    ]
    for index in indices:
        xr.testing.assert_identical(lazy.isel(index), whole.isel(index))


def test_values_are_read_when_asked_for(small: pw.Case, tmp_path: Path) -> None:
    pw.run(small, tmp_path)
    first = pw.open_result(tmp_path)
    second = pickle.loads(pickle.dumps(pw.open_result(tmp_path)))
    loaded = pw.open_result(tmp_path).load()
    xr.testing.assert_identical(second.load(), loaded)
    # No file stays open, and what was not read is gone with the file.
    (tmp_path / "result.h5").unlink()
    assert loaded["f"].sum() > 0
    with pytest.raises(FileNotFoundError):
        first["f"].load()


def test_measure_valued_data(tmp_path: Path) -> None:
    case = pw.Case(CASES / "example2.toml").replace(
        {"axis.0.x.cells": 16, "axis.0.v.cells": 16, "output.plateau": {"from": 0.0, "to": 2.0}}
    )
    data = pw.run(case, tmp_path).open()
    assert data["phi"].dims == ("x", "vx") and data["psi"].dims == ("component", "x", "vx")
    assert data["multivalued_x"].dims == data["multivalued_v"].dims == ("point",)
    assert data["plateau_p"].dims == data["plateau_distance"].dims == ("plateau",)
    assert data["density_exact"].dims == ("x",)
    assert data["momentum_exact"].dims == ("component", "x")
    case["output.moment_times"] = [0.2, 0.4]
    data = pw.run(case, tmp_path, force=True).open()
    assert data["density_exact"].dims == ("time", "x")
    assert data["density_exact"].attrs["long_name"] == "density of the exact solution"
    case["exact.moments"] = "end"
    data = pw.run(case, tmp_path, force=True).open()
    assert data["density"].dims == ("time", "x") and data["density_exact"].dims == ("x",)


def test_two_dimensions_and_readout(tmp_path: Path) -> None:
    case = pw.Case(CASES / "barrier2d.toml")
    case["readout"] = {"cells": [[1, 2]]}
    data = pw.run(case, tmp_path).open()
    assert data["f"].dims == ("x", "y", "vx", "vy")
    assert data["component"].values.tolist() == ["x", "y"]
    assert data["momentum"].sel(component="y").dims == ("x", "y")
    assert data["readout_estimate"].dims == ("readout",)
    assert "direction" not in data.coords


def test_warped_field(small: pw.Case, tmp_path: Path) -> None:
    result = pw.run(small, tmp_path, mode="full")
    warped = pw.open_result(tmp_path / "warped_f.h5")
    assert warped["w"].dims == ("x", "vx", "p")
    # A plan has few points: the trigonometric interpolant is read where the plan reads the modes.
    p = warped["p"].values
    period = p.size * (p[1] - p[0])
    with h5py.File(tmp_path / "warped_f.h5") as file:
        at = json.loads(file["plan"][()])["warp"]["readings"][0]["point"]
    modes = np.fft.fft(warped["w"].values) / p.size
    phases = np.exp(2j * np.pi * np.fft.fftfreq(p.size, 1 / p.size) * (at - p[0]) / period)
    np.testing.assert_allclose(np.exp(at) * (modes @ phases).real, result.open()["f"], atol=1e-6)


def test_other_formats(small: pw.Case, tmp_path: Path) -> None:
    data = pw.run(small, tmp_path).open()
    xr.testing.assert_identical(
        xr.open_dataset(tmp_path / "result.h5", engine="phasewarp").load(), data.load()
    )
    data.to_netcdf(tmp_path / "copy.nc", engine="h5netcdf")
    copy = xr.open_dataset(tmp_path / "copy.nc", engine="h5netcdf")
    xr.testing.assert_equal(copy, data)
    assert copy.attrs["title"] == data.attrs["title"]
    assert "density" in data[["density"]].to_dataframe()
    assert set(pw.open_result(tmp_path, drop_variables=["f"])) == set(data) - {"f"}


def test_no_result(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no result of phasewarp"):
        pw.open_result(tmp_path)


def test_figures_and_report(small: pw.Case, tmp_path: Path) -> None:
    result = pw.run(small, tmp_path)
    assert {path.name for path in result.plot()} >= {"phase_space.png", "moments.png"}
    assert "<html" in result.report().read_text()


@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_a_result_is_found_from_anywhere(
    small: pw.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = pw.run(small, "results/small")
    assert result.directory == tmp_path / "results" / "small"
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert "f" in result.open() and result.summary["mass"] > 0


@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_other_files_are_refused_by_name(small: pw.Case, tmp_path: Path) -> None:
    pw.run(small, tmp_path)
    for name in ("summary.json", "grids.h5"):
        with pytest.raises(OSError, match=rf"{name}: not a file that a run writes its fields to"):
            pw.open_result(tmp_path / name)
    with pytest.raises(FileNotFoundError, match="none: no result"):
        pw.open_result(tmp_path / "none")
    w = xr.DataArray(np.ones((2, 2, 2)), coords={n: [0.0, 1.0] for n in ("x", "vx", "p")})
    with pytest.raises(OSError, match=r"w\.h5: not a file that a run writes"):
        pw.open_result(pw.write_warped(w, tmp_path / "w.h5"))
