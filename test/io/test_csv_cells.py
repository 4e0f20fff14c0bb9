"""Text in cells of tables: no formulas, and nothing that UTF-8 cannot hold."""

import csv
import io

import pytest

from lrtrav_ros.io.csv_cells import cell_text, cells, printable

NOT_UTF8 = b"caf\xe9".decode("utf-8", "surrogateescape")


@pytest.mark.parametrize("start", ["=", "+", "-", "@", "\t", "\r"])
def test_texts_that_spreadsheets_take_for_formulas_get_an_apostrophe(start):
    assert cell_text(f"{start}HYPERLINK(1)") == f"'{start}HYPERLINK(1)"
    assert cell_text(f"a{start}1") == f"a{start}1"


@pytest.mark.parametrize("number", ["-1", "+1", "-0.5", "-1.5e-07", "-inf", "nan", "", "000123", "frame"])
def test_numbers_and_usual_names_stay(number):
    assert cell_text(number) == number


def test_no_two_names_have_one_cell():
    names = ["=a", "'=a", "''=a", "'a", "a"]
    found = [cell_text(name) for name in names]
    assert len(set(found)) == len(names)
    assert [cell[1:] if cell.startswith("'") else cell for cell in found] == names


def test_names_that_are_not_utf8_can_be_written():
    assert printable(NOT_UTF8) == r"caf\udce9"
    assert printable("Höhe \N{EN DASH}") == "Höhe \N{EN DASH}"
    assert cells({"name": f"={NOT_UTF8}", "slope": "-0.5"}) == {"name": r"'=caf\udce9", "slope": "-0.5"}


def test_a_row_is_read_back_as_it_was_written():
    text = io.StringIO()
    csv.DictWriter(text, ["name", "problem"]).writerow(cells({"name": '@a,"b"\n', "problem": "-x"}))
    assert next(csv.reader(io.StringIO(text.getvalue()))) == ['\'@a,"b"\n', "'-x"]
