"""Pages of sections, as calibration, comparison and ranking write them."""

from markupsafe import Markup

from megalopta.report.sections import Section, write_sections

CHART = Markup('<svg role="img" aria-label="a line" viewBox="0 0 9 9"><path d="M0 0L9 9"/></svg>')
SECTIONS = [
    Section("The pixels", "What they are.", ("", "step", "offset"), (("median", "1 mV", "2 mV"),)),
    Section("How they saturate", charts=(CHART, CHART)),
]


def test_text_is_escaped_and_charts_are_not(tmp_path):
    write_sections(tmp_path / "page.html", "A < B", "In short.", SECTIONS)
    text = (tmp_path / "page.html").read_text("utf-8")
    assert "<h1>A &lt; B</h1>" in text
    assert text.count(CHART) == 2
