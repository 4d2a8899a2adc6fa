"""How far a diagnosis is: the share never falls, and work within a stage moves it."""

from dtbacklash.diagnose.search.course import Course
from dtbacklash.diagnose.spread import spread


def test_the_share_moves_with_the_work_and_never_falls():
    told: list[tuple[str, float]] = []
    course = Course(lambda text, share: told.append((text, share)))
    course.at("first", 0.1, 0.5)
    assert spread(lambda x: x * x, range(4), course.part(0.5, 1.0)) == [0, 1, 4, 9]
    course.at("second", 0.3, 0.7)
    course.part(0.0, 1.0)(1, 1)
    course.at("third", 0.8)
    course.part(0.0, 1.0)(1, 2)
    assert [text for text, _ in told] == ["first"] * 5 + ["second"] * 2 + ["third"] * 2
    shares = [round(share, 9) for _, share in told]
    assert shares == [0.1, 0.35, 0.4, 0.45, 0.5, 0.5, 0.7, 0.8, 0.8]
    assert course.stage == "third"


def test_a_second_search_tells_of_itself_and_changes_no_belief():
    told: list[tuple[str, float]] = []
    course = Course(lambda text, share: told.append((text, share)))
    course.at("first", 0.5)
    second = course.again()
    second.at("looking once more", 0.1)
    second.at("judging", 0.6)
    assert told == [("first", 0.5), ("looking once more", 0.5), ("judging", 0.6)]
    assert course.stage == "judging"
    assert course.believed is None
