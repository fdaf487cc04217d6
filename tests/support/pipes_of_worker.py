"""Hands its standard input, output and error to a fork by the server of ``forked_workers``; ends with it.

A script of the standard library, since each worker starts one.
"""

import socket
import sys


def main(address: str) -> int:
    with socket.socket(socket.AF_UNIX) as server:
        server.connect(address)
        socket.send_fds(server, [b"."], [0, 1, 2])
        code = server.recv(1)
    return code[0] if code else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
