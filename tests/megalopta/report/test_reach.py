"""The first finding names the best method and the darkest light at which it is still accurate."""

from megalopta.dataset.flow_record import FlowRecord
from megalopta.report.reach import reach_findings


def record(method, level, error, sensor="ideal", corrected=None):
    def blocks(median):
        return {
            "blocks": 9,
            "missing_fraction": 0.0,
            "endpoint_error_px": 1.0,
            "endpoint_error_median_px": 1.0,
            "angular_error_deg": 1.0,
            "bias_px": (0.0, 0.0),
            "spread_px": (0.0, 0.0),
            "relative_error_median": median,
            "outlier_fraction": 0.5,
        }

    truth = {"ideal": blocks(0.0), "counts": blocks(error)}
    if corrected is not None:
        truth["corrected"] = blocks(corrected)
    return FlowRecord.model_validate(
        {
            "sensor": sensor,
            "level": level,
            "method": method,
            "warm_up_frames": 0,
            "error": {"literal": 0.0, "ratio": 0.0},
            "truth": truth,
        }
    )


def told(*records):
    return [each.replace("\u00a0", " ") for each in reach_findings(records)]


def test_the_method_that_reaches_the_darkest_light_is_named_with_its_error_there():
    (found,) = told(
        *(record("PF", level, error) for level, error in ((10, 0.1), (1, 0.2), (0.1, 0.3))),
        *(record("BM", level, error) for level, error in ((10, 0.05), (1, 0.4), (0.1, 0.9))),
    )
    assert found == (
        "On ideal, PF stays within 25 % of the true flow (median over blocks) down to 1 lux, "
        "where its median error is 20 %."
    )


def test_accuracy_beyond_a_level_where_it_is_lost_does_not_count():
    (found,) = told(record("PF", 10, 0.1), record("PF", 1, 0.5), record("PF", 0.1, 0.1))
    assert "down to 10 lux" in found


def test_bright_levels_that_saturate_a_sensor_are_passed_over():
    (found,) = told(record("PF", 1e4, 1.0), record("PF", 10, 0.1), record("PF", 1, 0.5))
    assert "down to 10 lux" in found


def test_corrected_readings_are_a_method_of_their_own():
    (found,) = told(record("PF", 10, 0.6, corrected=0.2))
    assert "PF on corrected readings stays within" in found


def test_where_no_method_is_accurate_the_nearest_is_named():
    (found,) = told(record("PF", 10, 0.4), record("BM", 10, 0.9), record("PF", 1, 0.7))
    assert found == (
        "On ideal, no method comes within 25 % of the true flow at any of these light levels; "
        "the nearest is PF at 10 lux, with a median error of 40 %."
    )


def test_where_nothing_moves_no_method_is_judged():
    assert told(record("BM", 10, None)) == [
        "On ideal, nothing is known to move, so no flow can be judged."
    ]


def test_each_sensor_has_its_sentence_and_the_one_of_least_light_comes_first():
    found = told(
        record("BM", 10, 0.9, sensor="spadcam"),
        record("BM", 10, 0.1),
        *(record("BM", level, 0.1, sensor="best") for level in (10, 1)),
    )
    assert [each.split(",")[0] for each in found] == ["On best", "On ideal", "On spadcam"]
