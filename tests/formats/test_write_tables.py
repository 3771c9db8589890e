"""Truth: Python's own csv reader and NumPy's own loader; the motions that were written."""

import csv
import io

import numpy as np

from pacmo_core.data.skeleton import SBU15, Skeleton
from pacmo_core.formats.write_tables import format_csv, npz_bytes
from tests.figures.samples import interaction

SEEN = interaction(1)
PEOPLE = (SEEN.person_a, SEEN.person_b)


def test_a_csv_gives_every_number_back_as_it_was() -> None:
    rows = list(csv.reader(io.StringIO(format_csv(SBU15, SEEN.times, PEOPLE))))
    assert rows[0][:4] == ["frame", "time", "a.head.x", "a.head.y"]
    assert rows[0][-1] == "b.right_foot.z"
    values = np.array(rows[1:], np.float64)
    np.testing.assert_array_equal(values[:, 0], np.arange(len(SEEN.times)))
    np.testing.assert_allclose(values[:, 1], SEEN.times, atol=1e-9)
    back = values[:, 2:].astype(np.float32).reshape(len(values), 2, 15, 3)
    np.testing.assert_array_equal(back, np.stack(PEOPLE, axis=1))


def test_a_joint_named_with_commas_and_marks_is_one_column() -> None:
    odd = Skeleton("odd", ('a,"b"', "c"), (-1, 0))
    text = format_csv(odd, SEEN.times, [SEEN.person_a[:, :2]])
    assert next(csv.reader(io.StringIO(text)))[2] == 'a.a,"b".x'


def test_an_npz_gives_arrays_and_facts_back_without_pickle() -> None:
    content = npz_bytes(SBU15, SEEN.times, PEOPLE, up="z", unit=0.01)
    with np.load(io.BytesIO(content), allow_pickle=False) as found:
        np.testing.assert_array_equal(found["person_a"], SEEN.person_a)
        np.testing.assert_array_equal(found["person_b"], SEEN.person_b)
        np.testing.assert_array_equal(found["times"], SEEN.times)
        assert tuple(found["joints"]) == SBU15.joints
        assert tuple(found["parents"]) == SBU15.parents
        assert (str(found["up"]), float(found["unit"])) == ("z", 0.01)


def test_a_person_alone_is_a() -> None:
    with np.load(io.BytesIO(npz_bytes(SBU15, SEEN.times, PEOPLE[:1], up="y", unit=1.0))) as found:
        assert "person_b" not in found
    header = format_csv(SBU15, SEEN.times, PEOPLE[:1]).splitlines()[0]
    assert header.count(",") == 1 + 45
