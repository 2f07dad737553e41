"""The command on a machine without a network: python -m tests.app.offline LOG ARGUMENTS...

Whatever asks for another machine is refused, and noted in the file LOG.
"""

import ipaddress
import sys
from pathlib import Path
from typing import Any


def _is_here(host: Any) -> bool:
    name = host.decode() if isinstance(host, bytes) else str(host)
    try:
        return ipaddress.ip_address(name).is_loopback or name == "0.0.0.0"
    except ValueError:
        return name in ("None", "", "localhost")


def cut_network(log: Path) -> None:
    """From now on, in this process."""

    def refuse(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "socket.getaddrinfo":
            host = arguments[0]
        elif event == "socket.connect" and isinstance(arguments[1], tuple):
            host = arguments[1][0]
        else:
            return
        if not _is_here(host):
            with log.open("a") as file:
                file.write(f"{event} {host}\n")
            raise OSError(f"no network: {event} {host}")

    sys.addaudithook(refuse)


if __name__ == "__main__":
    cut_network(Path(sys.argv.pop(1)))
    from steered_marigold.cli import main

    sys.argv[0] = "steered-marigold"
    main()
