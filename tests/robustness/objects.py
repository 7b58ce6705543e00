"""A server of objects (moto's) as a process of its own, which tests may kill, and the plainest of clients."""

import json
import socket
import subprocess
import sys
import time
import urllib.request
from contextlib import closing

BUCKET = "bakery-test"
# the server asks who it is, and believes it
_WHO = "AWS4-HMAC-SHA256 Credential=test/20260101/us-east-1/s3/aws4_request, SignedHeaders=host, Signature=0"


class Server:
    """Started by `with`; `call` is one request."""

    def __init__(self):
        with closing(socket.socket()) as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.endpoint = f"http://127.0.0.1:{self.port}"
        self.address = f"s3://{BUCKET}/cache"

    def __enter__(self):
        self._process = subprocess.Popen([sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(self.port)],
                                         stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        patience = time.monotonic() + 60
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), 1).close()
                break
            except OSError:
                if self._process.poll() is not None or time.monotonic() > patience:
                    raise
                time.sleep(0.1)
        self.call("PUT", BUCKET)
        # without versions this server closes an object that is replaced under those that read it: status 500
        self.call("PUT", f"{BUCKET}?versioning", b"<VersioningConfiguration><Status>Enabled</Status></VersioningConfiguration>")
        return self

    def __exit__(self, *_):
        self.kill()

    def kill(self):
        self._process.kill()
        self._process.wait()

    def call(self, method: str, path: str, data: bytes | None = None) -> bytes:
        headers = {"Authorization": _WHO, "Content-Type": "application/octet-stream"}
        with urllib.request.urlopen(urllib.request.Request(f"{self.endpoint}/{path}", data, headers, method=method)) as answer:
            return answer.read()

    def deny(self, *actions: str) -> None:
        """Refuse what `s3:` actions stand for, from now on; without any nothing is refused."""
        rule = {"Effect": "Deny", "Principal": "*", "Action": list(actions), "Resource": f"arn:aws:s3:::{BUCKET}/*"}
        if actions:
            self.call("PUT", f"{BUCKET}?policy", json.dumps({"Version": "2012-10-17", "Statement": [rule]}).encode())
        else:
            self.call("DELETE", f"{BUCKET}?policy")


def environment(home, address: str, endpoint: str = "", **more) -> dict[str, str]:
    """Of a machine whose own cache is in the folder `home`, and which shares what is at an address."""
    return {"HOME": str(home), "XDG_CACHE_HOME": str(home / "cache"), "BAKERY_CACHE": address, "AWS_ENDPOINT_URL": endpoint,
            "AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_EC2_METADATA_DISABLED": "true", **more}
