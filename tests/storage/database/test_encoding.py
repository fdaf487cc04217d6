"""A database of Postgres that cannot hold every text is refused in one line, and left as it is."""

import pytest

from service.storage.database.migration import EncodingError, MigrationError, migrate, migrate_or_explain


@pytest.fixture(params=["SQL_ASCII", "LATIN1"])
def other_encoding(request, postgres):
    name = postgres.create_database(encoding=request.param)
    yield request.param, postgres.url(name)
    postgres.drop_database(name)


def test_another_encoding_than_utf8_is_refused_with_what_helps(other_encoding):
    encoding, url = other_encoding
    with pytest.raises(EncodingError, match=encoding):
        migrate(url)
    with pytest.raises(MigrationError, match="ENCODING 'UTF8'") as refused:
        migrate_or_explain(url)
    assert len(str(refused.value).splitlines()) == 1
