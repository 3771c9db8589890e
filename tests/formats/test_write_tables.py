"""Truth: Python's own csv reader, NumPy's own loader and Polars; the motions that were written."""

import csv
import io

import numpy as np
import polars as pl

from pacmo_core.data.skeleton import SBU15, Skeleton
from pacmo_core.formats.write_tables import JointTable, csv_table, npz_table, parquet_table
from tests.figures.samples import interaction

SEEN = interaction(1)
PEOPLE = (SEEN.person_a, SEEN.person_b)
TABLE = JointTable(SBU15, SEEN.times, PEOPLE, up="z", unit=0.01)
ALONE = JointTable(SBU15, SEEN.times, PEOPLE[:1], up="y", unit=1.0)


def csv_rows(table: JointTable) -> tuple[list[str], list[list[str]]]:
    """Split a table into the lines of its facts and the rows below them."""
    lines = csv_table(table).decode().splitlines()
    facts = [line for line in lines if line.startswith("#")]
    return facts, list(csv.reader(lines[len(facts) :]))


def test_a_csv_gives_every_number_back_as_it_was() -> None:
    facts, rows = csv_rows(TABLE)
    assert facts[:3] == ["# fps: 15", "# unit: 0.01", "# up: z"]
    assert facts[3].startswith("# parents: 1 2 -1 1 3")
    assert rows[0][:4] == ["frame", "time", "person_a.head.x", "person_a.head.y"]
    assert rows[0][-1] == "person_b.right_foot.z"
    values = np.array(rows[1:], np.float64)
    np.testing.assert_array_equal(values[:, 0], np.arange(len(SEEN.times)))
    np.testing.assert_allclose(values[:, 1], SEEN.times, atol=1e-9)
    back = values[:, 2:].astype(np.float32).reshape(len(values), 2, 15, 3)
    np.testing.assert_array_equal(back, np.stack(PEOPLE, axis=1))


def test_a_joint_named_with_commas_and_marks_is_one_column() -> None:
    odd = Skeleton("odd", ('a,"b"', "c"), (-1, 0))
    _, rows = csv_rows(JointTable(odd, SEEN.times, [SEEN.person_a[:, :2]], up="y", unit=1.0))
    assert rows[0][2] == 'person_a.a,"b".x'


def test_an_npz_gives_arrays_and_facts_back_without_pickle() -> None:
    with np.load(io.BytesIO(npz_table(TABLE)), allow_pickle=False) as found:
        np.testing.assert_array_equal(found["person_a"], SEEN.person_a)
        np.testing.assert_array_equal(found["person_b"], SEEN.person_b)
        np.testing.assert_array_equal(found["times"], SEEN.times)
        assert tuple(found["joints"]) == SBU15.joints
        assert tuple(found["parents"]) == SBU15.parents
        assert (str(found["up"]), float(found["unit"])) == ("z", 0.01)
        assert float(found["fps"]) == np.float64(1 / np.median(np.diff(SEEN.times)))


def test_a_parquet_has_the_columns_of_the_csv_and_its_facts_as_metadata() -> None:
    content = parquet_table(TABLE)
    found = pl.read_parquet(io.BytesIO(content))
    assert found.columns == csv_rows(TABLE)[1][0]
    back = found.to_numpy()[:, 2:].astype(np.float32).reshape(len(found), 2, 15, 3)
    np.testing.assert_array_equal(back, np.stack(PEOPLE, axis=1))
    facts = pl.read_parquet_metadata(io.BytesIO(content))
    assert (facts["fps"], facts["unit"], facts["up"]) == ("15", "0.01", "z")
    assert facts["parents"].startswith("1 2 -1 1 3")


def test_a_person_alone_is_a() -> None:
    with np.load(io.BytesIO(npz_table(ALONE))) as found:
        assert "person_b" not in found
    header = csv_rows(ALONE)[1][0]
    assert len(header) == 2 + 45
    assert pl.read_parquet(io.BytesIO(parquet_table(ALONE))).columns == header
