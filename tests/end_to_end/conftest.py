import pytest

from tests.support.serving import Service


@pytest.fixture
def service(running_service: Service) -> Service:
    return running_service
