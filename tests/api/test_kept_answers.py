"""Answers that were written before are kept by their tags, the latest asked for, in limited memory."""

from service.api.replies.kept_answers import KeptAnswers


def test_an_answer_is_written_once_as_long_as_there_is_room():
    answers, written = KeptAnswers(most_bytes=10), []

    def ask(tag, content=b"12345"):
        return answers.get(tag, lambda: written.append(tag) or content)

    assert [ask("a"), ask("a"), ask("b"), ask("a")] == [b"12345"] * 4
    assert written == ["a", "b"]
    ask("c")  # for which b has to go: a was asked for since
    ask("a")
    ask("b")
    assert written == ["a", "b", "c", "b"]
    assert ask("large", bytes(11)) == bytes(11)
    ask("large", bytes(11))
    assert written[4:] == ["large", "large"]
