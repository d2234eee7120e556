"""A page of the viewer as a program: the other end of its WebSocket, with nothing but sockets."""

import base64
import contextlib
import json
import os
import socket
import struct
import urllib.parse


class Page:
    """A page of the viewer: `receive` reads its messages; pictures are acknowledged as a page does it."""

    def __init__(self, address, timeout=60):
        url = urllib.parse.urlsplit(address)
        self.socket = socket.create_connection((url.hostname, url.port), timeout)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall((f"GET /ws HTTP/1.1\r\nHost: {url.netloc}\r\nUpgrade: websocket\r\n"
                             f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
                             "Sec-WebSocket-Version: 13\r\n\r\n").encode())
        self.file = self.socket.makefile("rb")
        answer = self.file.readline()
        if b" 101 " not in answer:
            raise ConnectionError(answer.decode())
        while self.file.readline() not in (b"\r\n", b""):
            pass
        self.num_pictures = 0
        self.kinds = set()  # of the binary messages that came

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Without a word: the connection just ends."""
        with contextlib.suppress(OSError):
            self.file.close()
            self.socket.close()

    def send(self, message, kind=1):
        data = json.dumps(message).encode() if kind == 1 else message
        size = len(data)
        head = bytes([0x80 | kind]) + (bytes([0x80 | size]) if size < 126
                                       else b"\xfe" + struct.pack(">H", size))
        self.socket.sendall(head + b"\0\0\0\0" + data)  # masked by nothing

    def receive(self):
        """The next message in text, or None for a binary one."""
        first, size = self.file.read(2)
        if size >= 126:
            size = int.from_bytes(self.file.read(2 if size == 126 else 8), "big")
        data = self.file.read(size)
        if first & 15 == 9:
            self.send(data, kind=10)
        elif first & 15 == 2:
            self.kinds.add(int.from_bytes(data[:2], "little"))
        elif first & 15 == 1:
            message = json.loads(data)
            if message["type"] == "picture":
                self.num_pictures += 1
                self.send({"ack": message["number"]})
            return message
        return None
