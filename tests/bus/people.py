"""Certificates, password files and sessions of those who may, and may not, take part."""

import subprocess
from contextlib import contextmanager
from pathlib import Path

import zenoh

from observer.bus.session import client_config
from observer.bus.zenoh import ServiceIdentity, ZenohPublisher
from observer.config.publishing import Client, Publish
from tests.bus.blocks import LAYOUT
from tests.bus.router import free_port
from tests.patience import until as wait

PREFIX = "ballscrew/lathe-7/z"
_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")


def _openssl(*words: str, folder: Path) -> None:
    subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)


class Authority:
    """An authority of its own that signs certificates, with the command that a plant would use."""

    def __init__(self, folder: Path, name: str = "plant") -> None:
        self._folder, self._name = folder, name
        self.ca = folder / f"{name}.pem"
        subject = ("-subj", f"/CN={name}", "-days", "30", "-addext", "basicConstraints=critical,CA:TRUE")
        _openssl(
            "req", "-x509", *_KEY, *subject, "-keyout", f"{name}.key", "-out", f"{name}.pem", folder=folder
        )

    def sign(self, name: str) -> dict[str, Path]:
        """A certificate in this name and its key, as a [tls] table without more."""
        folder, stem = self._folder, f"{self._name}-{name}"
        (folder / "extensions").write_text("subjectAltName=IP:127.0.0.1\nbasicConstraints=CA:FALSE\n")
        _openssl(
            "req", *_KEY, "-subj", f"/CN={name}", "-keyout", f"{stem}.key", "-out", "request", folder=folder
        )
        signing = (
            "-CA",
            f"{self._name}.pem",
            "-CAkey",
            f"{self._name}.key",
            "-CAcreateserial",
            "-days",
            "30",
        )
        _openssl(
            "x509", "-req", "-in", "request", *signing, "-extfile", "extensions", "-out", f"{stem}.pem",
            folder=folder,
        )  # fmt: skip
        return {"certificate": folder / f"{stem}.pem", "key": folder / f"{stem}.key"}


def secret(path: Path, text: str) -> Path:
    """A file that only its owner can read."""
    path.write_text(text)
    path.chmod(0o600)
    return path


def user(folder: Path, name: str, password: str) -> Client:
    """A client with a name and a password."""
    file = secret(folder / f"{name}.password", password)
    return Client.model_validate({"login": {"user": name, "password_file": file}})


@contextmanager
def published(
    scheme: str = "tcp", digest: str = "ab12", compensates: bool = True, axis: str = "z", **settings
):
    """A publisher that is a router, and its endpoint; it is commanded by hand."""
    endpoint = f"{scheme}/127.0.0.1:{free_port()}"
    publish = Publish.model_validate({"mode": "router", "listen": (endpoint,), **settings})
    made = ZenohPublisher(
        ServiceIdentity("lathe-7", axis, "0a0a0a0a"),
        publish,
        f'{{"hash":"{digest}"}}',
        LAYOUT,
        offers=["compensation"] if compensates else [],
    )
    made.start()
    wait(lambda: made.status.connected)
    yield made, endpoint
    assert made.close(5.0)


@contextmanager
def session(endpoint: str, client: Client | None = None):
    """A client's session; raises `zenoh.ZError` where it is not let in."""
    with zenoh.open(client_config((endpoint,), client)) as opened:
        yield opened


def ask(opened, selector: str, **more):
    """All answers to one question, in words; what went wrong begins with an exclamation mark."""
    words = []
    for reply in opened.get(selector, timeout=1.5, **more):
        words.append(reply.ok.payload.to_string() if reply.ok else f"! {reply.err.payload.to_string()}")
    return words
