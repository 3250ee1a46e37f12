"""One flight: what Python has is what the program prints."""

import ast
import inspect
import pickle
from pathlib import Path

import gaware
import pandas as pd
import polars as pl
import pytest


@pytest.fixture(scope="module")
def flight(log):
    return gaware.replay(log)


def test_the_summary_is_the_document_of_the_program(flight, log, program):
    assert flight.summary == program("replay", log, "--json")


def test_the_tables_are_those_of_the_program(flight, log, program, tmp_path):
    program("replay", log, "--export", tmp_path / "tables")
    program("replay", log, "--export", tmp_path / "states.csv")
    files = {path.stem: path for path in (tmp_path / "tables").iterdir()}
    assert set(files) == {table.name for table in flight.tables}
    for table in flight.tables:
        frame = table.to_polars()
        assert frame.equals(pl.read_parquet(files[table.name])), table.name
        assert list(table.columns) == frame.columns and len(table) == frame.height
    csv = pd.read_csv(tmp_path / "states.csv", keep_default_na=False, na_values=[""])
    pd.testing.assert_frame_equal(flight.states.to_pandas(), csv, check_dtype=False, rtol=1e-14)


def test_parts_of_the_states_are_the_same_values(flight):
    states = flight.states.to_polars()
    for part in (flight.sigmas, flight.innovations):
        frame = part.to_polars()
        assert frame.columns[:3] == ["log", "elapsed_s", "t_s"]
        assert frame.equals(states.select(frame.columns))
    assert "g11_sigma_deg_per_h_per_g" in flight.sigmas.columns
    assert "innovation_position_north_sigma" in flight.innovations.columns
    assert flight.samples.to_polars().height == flight.summary["imu"]["samples"]


def test_a_model_goes_in_and_comes_out(log, program, tmp_path):
    model = gaware.Model.standard().without("gps_latency")
    assert "gps_latency" not in model.effects
    model.save(tmp_path / "model.toml")
    assert gaware.Model.load(tmp_path / "model.toml") == model == pickle.loads(pickle.dumps(model))
    summary = gaware.replay(log, model).summary
    assert summary == program("replay", log, "--model", tmp_path / "model.toml", "--json")
    assert summary != gaware.replay(log).summary


def test_an_explanation_is_that_of_the_program(clean, program, tmp_path):
    found = gaware.explain(clean)
    assert found.report == program("explain", clean, "--out", tmp_path / "program", "--json")
    assert found.verdict == found.report["verdict"]
    found.write(tmp_path / "python")
    model = gaware.Model.load(tmp_path / "program/model.toml")
    assert found.model == gaware.Model.load(tmp_path / "python/model.toml") == model
    written = (tmp_path / "python/report.json").read_bytes()
    assert written == (tmp_path / "program/report.json").read_bytes()
    assert (tmp_path / "python/report.html").stat().st_size > 10_000


def test_errors_are_the_sentences_of_the_program(tmp_path, log):
    with pytest.raises(gaware.LogError, match="cannot open .*nothing.tlog: No such file"):
        gaware.replay(tmp_path / "nothing.tlog")
    (tmp_path / "text.xyz").write_text("no flight")
    with pytest.raises(gaware.LogError, match="unsupported format; gaware reads .tlog"):
        gaware.explain([tmp_path / "text.xyz"])
    (tmp_path / "model.toml").write_text('schema = "gaware.model/1"\n[imu]\ngyro_noize = 1.0\n')
    with pytest.raises(gaware.ModelError, match="model.toml, line 3: .*gyro_noize"):
        gaware.Model.load(tmp_path / "model.toml")
    with pytest.raises(gaware.GawareError, match="no inertial message"):
        gaware.replay(log, source="NOTHING")
    with pytest.raises(gaware.GawareError, match="no log was given"):
        gaware.explain([])


def test_the_stubs_have_what_the_package_has():
    stubs = ast.parse((Path(gaware.__file__).parent / "__init__.pyi").read_text())
    classes = {node.name: node for node in stubs.body if isinstance(node, ast.ClassDef)}
    functions = {node.name: node for node in stubs.body if isinstance(node, ast.FunctionDef)}
    assert set(classes) | set(functions) | {"__version__", "fleet"} == set(gaware.__all__)
    for name, node in classes.items():
        own = {n for n in dir(getattr(gaware, name)) if not n.startswith("_")}
        stub = {n.name for n in node.body if isinstance(n, ast.FunctionDef) and not n.name.startswith("_")}
        if not issubclass(getattr(gaware, name), Exception):
            assert own == stub, name
    for name, node in functions.items():
        arguments = [a.arg for a in node.args.args + node.args.kwonlyargs]
        assert list(inspect.signature(getattr(gaware, name)).parameters) == arguments
