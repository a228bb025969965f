"""Cases and the arrays in them."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from conftest import CASES

import phasewarp as pw


def test_keys_of_a_file(small: pw.Case) -> None:
    assert small["axis.0.x.cells"] == 16
    assert small["potential.1.value"] == "0"
    assert "exact.kind" in small and "solver.warp.points" not in small
    with pytest.raises(KeyError, match=r"solver\.warp\.points: not given"):
        small["solver.warp.points"]
    with pytest.raises(KeyError, match="no such place"):
        small["title.more"] = 1
    assert small.settings()[0] == "axis.0.x.cells=16"


def test_copies_are_independent(made: pw.Case) -> None:
    other = made.replace({"axis.0.x.cells": 32, "scheme.degree": np.int64(2)})
    assert made["axis.0.x.cells"] == 16 and "scheme" not in made
    assert other["axis.0.x.cells"] == 32 and other["scheme.degree"] == 2
    assert other != made and made.replace({}) == made


def test_a_case_of_a_case(small: pw.Case) -> None:
    small["axis.0.x.cells"] = 24
    other = pw.Case(small, title="Another")
    assert other["title"] == "Another" and other.settings()[:-1] == small.settings()
    other["axis.0.x.cells"] = 32
    assert small["axis.0.x.cells"] == 24 and pw.check(pw.Case(small))["axes"][0]["elements"] == 24


def test_a_key_is_removed(small: pw.Case, made: pw.Case, tmp_path: Path) -> None:
    assert small.settings() and "exact" in pw.Case(small)
    small["exact.kind"] = "characteristics"
    del small["exact"]
    assert "exact" not in small and "exact" not in small.to_dict()
    assert not any(text.startswith("exact") for text in small.settings())
    assert repr(small).endswith("without exact>")
    assert not any(key.startswith("exact") for key in pw.check(pw.Case(small))["settings"])
    assert pw.check(small)["axes"][0]["elements"] == 16
    # The same as an empty table.
    empty = pw.Case(CASES / "example1.toml", exact={})
    assert not any(key.startswith("exact") for key in pw.check(empty)["settings"])
    del made["potential.0"]
    assert made["potential"] == [{"value": 0}]
    with pytest.raises(KeyError, match="not given in this case"):
        del made["scheme.degree"]
    with pytest.raises(KeyError, match=r"scheme\.degree: not given in this case; the program has"):
        made["scheme.degree"]


def test_an_array_for_a_formula_is_refused(made: pw.Case) -> None:
    f = np.zeros((16, 18))
    with pytest.raises(ValueError, match=r"^initial\.f: a formula .*write_table .*initial\.table"):
        made["initial.f"] = f
    before = made.to_dict()
    for value in (f, f.tolist(), xr.DataArray(f)):
        with pytest.raises(ValueError, match=r"^initial\.f: a formula"):
            made["initial"] = {"f": value}
    with pytest.raises(ValueError, match=r"^potential\.1\.value: .*potential_table"):
        made["potential"] = [{"value": 0}, {"value": f[0]}]
    assert made.to_dict() == before
    made["potential"] = [{"value": np.float64(0)}]


def test_a_table_replaces_the_whole_table(small: pw.Case) -> None:
    small["solver.propagator.step"] = 0.1
    small["solver.propagator"] = {"method": "chebyshev"}
    assert "solver.propagator.step" not in small
    # And the program applies both in the same order.
    assert "propagator chebyshev" in pw.describe(small)


@pytest.mark.parametrize("name", sorted(p.name for p in CASES.glob("*.toml")))
def test_toml_keeps_every_case(name: str) -> None:
    tree = tomllib.loads((CASES / name).read_text())
    assert tomllib.loads(pw.Case(CASES / name).to_toml()) == tree
    assert pw.Case(tree).to_dict() == tree


def test_toml_of_odd_values(tmp_path: Path) -> None:
    odd = {
        "text": 'quote " backslash \\ newline \n tab \t delete \x7f umlaut ü emoji 😀',
        "a key": {"nested.key": [1, 2.5, 1e-300, -0.0, float("inf"), True, "x", [], {}]},
        "list": [{"a": {"b": [{"c": 1}]}}, {}],
    }
    path = pw.Case(odd).save(tmp_path / "odd.toml")
    assert tomllib.loads(path.read_text(encoding="utf-8")) == odd
    assert pw.Case(path).to_dict() == odd
    with pytest.raises(TypeError, match="numbers, texts, lists and tables"):
        pw.Case(time={"end": None})


def test_the_program_reads_what_is_made_here(made: pw.Case) -> None:
    said = pw.describe(made)
    assert 'A "barrier" \\ of tests' in said
    assert "V = 0.2  where abs(x) < 0.25" in said


def test_check_returns_data(made: pw.Case) -> None:
    with pytest.warns(pw.PhasewarpWarning, match="mass"):
        found = pw.check(made)
    assert found["ok"] and found["cells"] > 0 and "mass" in found["warnings"][0]
    assert [axis["name"] for axis in found["axes"]] == ["x", "vx"]
    made["constants"] = {"T": 0.5}
    made["time.end"] = "-2*T"
    with pytest.raises(pw.CaseError, match=r"time\.end = \"-2\*T\" \(-1\)") as caught:
        pw.check(made)
    details = caught.value.details
    assert details is not None and details["key"] == "time.end" and details["value"] == '"-2*T"'


def test_faces_of_constants(made: pw.Case) -> None:
    expected = made.faces("x")
    made["constants"] = {"L": float(expected[-1])}
    made["axis.0.x.lower"], made["axis.0.x.upper"] = "-L", "L"
    np.testing.assert_array_equal(made.faces("x"), expected)


def test_faces_of_an_axis_that_is_not_there(made: pw.Case) -> None:
    with pytest.raises(KeyError, match="z: the case has 1 dimensions of space"):
        made.faces("z")


def test_faces_of_a_float(made: pw.Case) -> None:
    expected = made.faces("x")
    made["axis.0.x.cells"] = float(len(expected) - 1)
    np.testing.assert_array_equal(made.faces("x"), expected)


def test_grid(made: pw.Case) -> None:
    grid = made.grid()
    assert list(grid) == ["x", "vx"]
    np.testing.assert_allclose(grid["x"], -1 + (np.arange(16) + 0.5) / 8)
    np.testing.assert_allclose(made.faces("v"), made.faces("vx"))
    with pytest.raises(ValueError, match="degree"):
        made.replace({"scheme.degree": 2}).grid()


def evaluate(regions: list[dict[str, str]], **at: float) -> float:
    """Return V as the program finds it: the first region that holds."""
    for region in regions:
        if eval(region.get("where", "True").replace("&&", "and"), dict(at)):
            return float(eval(region["value"], dict(at)))
    raise AssertionError("no region without a condition")


def test_potential_of_points() -> None:
    x = np.array([-1.0, -0.2, 0.3, 0.3, 1.0])
    v = np.array([0.0, 0.4, 0.1, 0.7, -0.2])
    regions = pw.potential_table(v, x)
    assert len(regions) == 3
    for at in np.linspace(-0.99, 0.99, 37):
        side = slice(0, 3) if at < 0.3 else slice(3, 5)
        assert evaluate(regions, x=at) == pytest.approx(np.interp(at, x[side], v[side]))


def test_potential_of_steps() -> None:
    edges = np.linspace(-1, 1, 6)
    v = np.array([0.0, 0.3, 0.1, 0.3, 0.0])
    regions = pw.potential_table(v, edges)
    assert [evaluate(regions, x=c) for c in 0.5 * (edges[1:] + edges[:-1])] == v.tolist()
    # Neighbours of the same height are one region.
    v[2] = 0.3
    regions = pw.potential_table(v, edges)
    assert [region["value"] for region in regions] == ["0.0", "0.3", "0.0"]
    assert [evaluate(regions, x=c) for c in 0.5 * (edges[1:] + edges[:-1])] == v.tolist()


def test_potential_in_the_plane() -> None:
    x, y = np.linspace(-1, 1, 4), np.array([0.0, 0.5, 2.0])
    v = np.random.default_rng(0).normal(size=(4, 3))
    regions = pw.potential_table(v, x, y)
    table = xr.DataArray(v, coords={"x": x, "y": y})
    for at_x, at_y in np.random.default_rng(1).uniform([-1, 0], [1, 2], size=(40, 2)):
        expected = float(table.interp(x=at_x, y=at_y))
        assert evaluate(regions, x=at_x, y=at_y) == pytest.approx(expected, abs=1e-12)


def test_refused_potentials() -> None:
    x = [0.0, 1.0, 2.0]
    with pytest.raises(ValueError, match="shape"):
        pw.potential_table([1.0], x)
    with pytest.raises(ValueError, match="ascend"):
        pw.potential_table([1.0, 2.0, 3.0], x[::-1])
    with pytest.raises(ValueError, match="finite"):
        pw.potential_table([1.0, np.nan, 3.0], x)
    with pytest.raises(ValueError, match="axes"):
        pw.potential_table(1.0)


def test_an_array_is_the_formula(made: pw.Case, tmp_path: Path) -> None:
    """A potential by points gives the results of the formula that it tabulates."""
    made["potential"] = [{"value": "0.3*x"}]
    by_formula = pw.run(made, tmp_path / "formula").open()
    faces = made.faces("x")
    made["potential"] = pw.potential_table(0.3 * faces, faces)
    by_table = pw.run(made, tmp_path / "table").open()
    xr.testing.assert_allclose(by_table["f"], by_formula["f"], atol=1e-10)
    made["potential"] = [{"value": "0.2*x"}]
    control = pw.run(made, tmp_path / "control").open()
    assert abs(control["f"] - by_formula["f"]).max() > 1e-3


def test_a_long_table_over_a_file(small: pw.Case) -> None:
    edges = np.linspace(-1.5, 1.5, 401)
    small["axis.0.x.cells"] = 400
    small["potential"] = pw.potential_table(np.where(edges < 0, 0.2, 0.0)[:-1], edges)
    assert "V = 0.2  where x < " in pw.describe(small)


def ringing(w: np.ndarray, p: np.ndarray, recovery: float, ends: list[float]) -> float:
    """Return the largest e^p◇ |w(p) - e^-p| of the periodic interpolant between `ends`."""
    between, period = 8, len(p) * (p[1] - p[0])
    modes = np.fft.rfft(w)
    modes[-1] /= 2
    fine = between * np.fft.irfft(modes, between * len(w))
    place = p[0] + period / len(fine) * np.arange(len(fine))
    turns = range(int((ends[1] - p[0]) / period) + 1)
    place = np.concatenate([place + turn * period for turn in turns])
    found = np.abs(np.tile(fine, len(turns)) - np.exp(-place))
    return float(np.exp(recovery) * found[(place >= ends[0]) & (place <= ends[1])].max())


@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_start_from_arrays(made: pw.Case, tmp_path: Path) -> None:
    """Arrays for f(0) and g(p) give what the formula and the same profile give."""
    # The field is periodic in p: the points hold all p that f depends on, up to p◇ + λ⁻T.
    p_lower, p_upper = -12.0, 20.0
    made["solver.warp"] = {
        "profile": "exponential",
        "coefficients": "sampled",
        "interval": [p_lower, p_upper],
        "points": 1024,
        "recovery": 1.0,
        "weights": "none",
    }
    made["solver.tolerance"] = 1e-2
    result = pw.run(made, tmp_path / "formula")
    expected = result.open()
    growth, decay = (result.summary[f"{name}_bound"] for name in ("growth", "decay"))
    ends = [1.0 - growth * made["time.end"], 1.0 + decay * made["time.end"]]
    assert 0.0 < ends[0] < 1.0 < 12.0 < ends[1] < p_upper
    grid = made.grid()
    x, v = np.meshgrid(grid["x"], grid["vx"], indexing="ij")
    f = xr.DataArray(np.exp(-20 * ((x + 0.6) ** 2 + (v - 0.6) ** 2)), coords=grid)
    p = np.linspace(p_lower, p_upper, 1024, endpoint=False)
    g = xr.DataArray(np.exp(-np.abs(p)), coords={"p": p})
    assert ringing(g.to_numpy(), p, 1.0, ends) < 1e-3
    # Points that end before do not hold it: the next period is read as if it were e^(-p).
    short = np.linspace(-6.0, 6.0, 512, endpoint=False)
    assert ringing(np.exp(-np.abs(short)), short, 1.0, ends) > 0.1
    made["initial"] = {"warped": pw.write_warped(f * g, tmp_path / "start.h5")}
    made["solver.warp"] = {"recovery": 1.0, "weights": "none"}
    with pytest.warns(pw.PhasewarpWarning):
        found = pw.run(made, tmp_path / "arrays").open()
    difference = float(abs(found["f"] - expected["f"]).max())
    assert difference < 2e-2 * float(expected["f"].max())
    with pytest.raises(ValueError, match="each with a coordinate"):
        pw.write_warped(f, tmp_path / "no_p.h5")


def test_a_table_from_an_array(made: pw.Case, tmp_path: Path) -> None:
    """On the cell centres an array gives what the formula gives; transposed as well."""
    # NumPy rounds its own way, and plans depend on the data: both are within the tolerance.
    made["solver.tolerance"] = 1e-8
    expected = pw.run(made, tmp_path / "formula").open()
    grid = made.grid()
    x, v = np.meshgrid(grid["x"], grid["vx"], indexing="ij")
    f = xr.DataArray(np.exp(-20 * ((x + 0.6) ** 2 + (v - 0.6) ** 2)), coords=grid)
    for number, array in enumerate((f, f.transpose())):
        made["initial"] = {"table": pw.write_table(array, tmp_path / f"f{number}.h5")}
        found = pw.run(made, tmp_path / f"table{number}").open()
        difference = np.linalg.norm(found["f"] - expected["f"])
        assert difference < 2e-8 * np.linalg.norm(expected["f"])
    # In one dimension the velocity is also called v, as in a case.
    made["initial"] = {"table": pw.write_table(f.rename(vx="v"), tmp_path / "v.h5")}
    assert pw.run(made, tmp_path / "v").open()["f"].equals(found["f"])
    v = xr.DataArray(0.1 * grid["x"] ** 2, coords={"x": grid["x"]})
    table = pw.write_table(v, tmp_path / "V.h5")
    made["potential"] = [{"table": table, "interpolation": "linear"}]
    points = pw.run(made, tmp_path / "potential").open()["potential"]
    assert np.allclose(points, v, atol=1e-12)


def test_what_is_no_table_is_refused(tmp_path: Path) -> None:
    x = np.linspace(0.0, 1.0, 3)
    f = xr.DataArray(x**2, coords={"x": x})
    path = tmp_path / "none.h5"
    with pytest.raises(TypeError, match="an xarray"):
        pw.write_table(f.values, path)  # type: ignore[arg-type]
    rows = [
        (xr.DataArray(f.values, dims=("x",)), path, "each with a coordinate"),
        (f.rename(x="q"), path, "dimensions"),
        (f.expand_dims(y=[0.0, 1.0]).rename(x="v"), path, "each with a coordinate; v is vx there"),
        (xr.DataArray(1.0), path, "dimensions"),
        (f.where(f > 0), path, "a value is not finite"),
        (f[::-1], path, "a coordinate does not ascend"),
        (xr.DataArray(x, coords={"x": [0.0, 0.0, 1.0]}), path, "does not ascend"),
        (f, tmp_path / "none.csv", "this writes HDF5"),
    ]
    for array, place, why in rows:
        with pytest.raises(ValueError, match=why):
            pw.write_table(array, place)
    assert not list(tmp_path.iterdir())


def test_a_relative_start_holds_from_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "case.toml").write_text('[initial]\nwarped = "start.h5"\n')
    start = pw.Case(tmp_path / "case.toml").to_dict()["initial"]["warped"]
    assert start == str(tmp_path / "start.h5")
    (tmp_path / "table.toml").write_text('[initial]\ntable = { file = "f0.csv" }\n')
    table = pw.Case(tmp_path / "table.toml").to_dict()["initial"]["table"]
    assert table["file"] == str(tmp_path / "f0.csv")
    monkeypatch.chdir(tmp_path)
    assert pw.Case(initial={"warped": "start.h5"}).to_dict()["initial"]["warped"] == start
