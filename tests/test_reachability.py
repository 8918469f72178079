"""Why no simulator answers is found out with a plain connection."""

import socket

from joybridge.client.reachability import why_unreachable


def test_a_host_name_that_is_unknown_is_told_from_a_port_on_which_nothing_listens():
    assert why_unreachable("no-such-host.invalid:5005") == "the host name 'no-such-host.invalid' is unknown here"
    assert why_unreachable("a..b:5005") == "the host name 'a..b' is unknown here"
    with socket.socket() as bound:  # bound without listening, so nobody else takes the port
        bound.bind(("127.0.0.1", 0))
        assert why_unreachable(f"127.0.0.1:{bound.getsockname()[1]}") == "nothing listens there"
        bound.listen()
        assert why_unreachable(f"127.0.0.1:{bound.getsockname()[1]}") == (
            "what listens there does not answer as a simulator; if it demands TLS, give --tls-ca"
        )


def test_a_socket_that_does_not_exist_is_told_from_one_that_does_not_answer(tmp_path):
    assert why_unreachable(f"unix:{tmp_path}/gone") == "there is no such socket"
    (tmp_path / "here").touch()
    assert why_unreachable(f"unix:{tmp_path}/here") == "it does not answer as a simulator"
