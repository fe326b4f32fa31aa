"""The page at the wheel is for one person on this machine: who else asks is refused, and all that is read is short."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from itertools import islice

import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.wheel.cockpit import Cockpit
from interplan_sumo.wheel.page import wheel_page
from interplan_sumo.wheel.server import MOST_BYTES, WheelServer, served
from tests.wheel.visitors import asked, events, hold


def no_replay(number: int) -> str:
    raise InputError(f"there is no drive {number} yet")


@pytest.fixture(scope="module")
def server() -> Iterator[WheelServer]:
    with served(Cockpit(), wheel_page(), no_replay, 0) as found:
        yield found


def test_it_listens_where_nobody_else_can_reach_it(server: WheelServer) -> None:
    assert server.server_address[0] == "127.0.0.1"
    assert server.address.startswith(f"http://127.0.0.1:{server.server_port}/")
    assert len(server.token) >= 32


def test_its_address_gives_the_page_that_may_ask_nobody_else_and_stays_in_no_cache(server: WheelServer) -> None:
    answer = asked(server, f"/{server.token}/")
    assert answer.status == 200
    assert "default-src 'none'" in answer.text
    assert "connect-src 'self'" in answer.text
    assert answer.headers["cache-control"] == "no-store"
    assert answer.headers["x-frame-options"] == "DENY"
    assert "access-control-allow-origin" not in answer.headers


@pytest.mark.parametrize("place", ["/", "/events", "/wrong/", "/wrong/events", "//", "/{token}"])
def test_without_the_token_there_is_nothing(server: WheelServer, place: str) -> None:
    wrong = place.replace("{token}", server.token[:-1])
    assert asked(server, wrong).status == 403
    assert asked(server, wrong, b"{}", Content_Type="application/json").status == 403


@pytest.mark.parametrize(
    "headers",
    [{"Host": "evil.example:80"}, {"Host": "127.0.0.1"}, {"Origin": "http://evil.example"}, {"Origin": "null"},
     {"Sec_Fetch_Site": "cross-site"}],
)  # fmt: skip
def test_who_comes_by_another_name_or_page_is_refused(server: WheelServer, headers: dict[str, str]) -> None:
    assert asked(server, f"/{server.token}/", None, **headers).status == 403
    assert asked(server, f"/{server.token}/events", None, **headers).status == 403


def test_localhost_is_this_machine_too(server: WheelServer) -> None:
    assert asked(server, f"/{server.token}/", Host=f"localhost:{server.server_port}").status == 200


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b'{"push": 0.5, "turn": -1}', 204), (b'{"push": 1.5}', 400), (b'{"push": NaN}', 400), (b'{"act": "fly"}', 400),
        (b'{"more": 1}', 400), (b"[" * 900, 400), (b"\xff", 400), (b" " * (MOST_BYTES + 1), 413),
    ],
)  # fmt: skip
def test_hands_say_what_hands_can_do_and_no_more(server: WheelServer, body: bytes, status: int) -> None:
    place = f"/{server.token}/hands"
    assert asked(server, place, body, Content_Type="application/json").status == status


def test_a_form_of_another_page_is_none_of_hands(server: WheelServer) -> None:
    place = f"/{server.token}/hands"
    assert asked(server, place, b"{}", Content_Type="text/plain").status == 404


@pytest.mark.parametrize("size", ["", "-1", "1e2", "99999999999", "٣"])
def test_a_length_that_is_none_is_refused_before_anything_is_read(server: WheelServer, size: str) -> None:
    head = f"POST /{server.token}/hands HTTP/1.1\r\nHost: {server.names[0]}\r\nContent-Type: application/json\r\n"
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=5.0) as line:
        line.sendall(f"{head}Content-Length: {size}\r\n\r\n".encode())
        assert b" 413 " in line.recv(100)


def test_there_is_no_replay_before_there_is_a_drive_nor_of_anything_else(server: WheelServer) -> None:
    for place in ("replay/0", "replay/9999999999", "replay/0000000", "replay/..", "replay/-1", "../", "secrets"):
        assert asked(server, f"/{server.token}/{place}").status == 404


def test_a_page_that_opens_later_is_told_all_of_the_scene_and_shuts_the_other_out(server: WheelServer) -> None:
    cockpit = server.cockpit
    cockpit.show_scene(id="old/0")
    cockpit.show_scene(id="nudge/0")
    cockpit.tell("frame", frame=0)
    with events(server) as first:
        assert [each["kind"] for each in islice(first, 2)] == ["scene", "frame"]
        with events(server) as second:
            assert next(second) == {"kind": "scene", "id": "nudge/0"}
            assert next(first) == {"kind": "elsewhere"}
            cockpit.tell("frame", frame=1)
            assert [each.get("frame") for each in islice(second, 2)] == [0, 1]


def test_what_is_held_is_what_was_said_last_and_wishes_come_in_their_order(server: WheelServer) -> None:
    server.cockpit.show_scene(id="nudge/0")
    with events(server) as stream:
        next(stream)
        assert hold(server, number=2, push=1.0, act="start") == 204
        assert hold(server, number=1, push=-1.0, act="pause") == 204
        assert server.cockpit.hands.push == 1.0
        assert [server.cockpit.next_act(0.0) for _ in range(3)] == ["start", "pause", None]


def test_a_port_in_use_is_said(server: WheelServer) -> None:
    with (
        pytest.raises(InputError, match=f"port {server.server_port}"),
        served(Cockpit(), "", no_replay, server.server_port),
    ):
        pass
