"""A server of one stream by RTSP over TCP (RFC 2326, packets of RTP interleaved), made of FFmpeg's RTP packets."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from itertools import count
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

PAYLOAD = 96


def rtp_packets(frames: list[NDArray[np.uint8]], rate: int, over: threading.Event) -> Iterator[bytes]:
    """Packets of RTP of H.264, in real time, of frames again and again; parameter sets come with every key frame."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        with av.open(f"rtp://127.0.0.1:{receiver.getsockname()[1]}?pkt_size=1200", "w", format="rtp") as container:
            options = {"g": "5", "preset": "ultrafast", "tune": "zerolatency", "x264-params": "repeat-headers=1"}
            stream: Any = container.add_stream("libx264", rate=rate, options=options)
            stream.height, stream.width = frames[0].shape[:2]
            stream.pix_fmt = "yuv420p"
            for number in count():
                if over.wait(1 / rate):
                    return
                picture = av.VideoFrame.from_ndarray(frames[number % len(frames)], format="rgb24")
                picture.pts, picture.time_base = number, Fraction(1, rate)
                container.mux(stream.encode(picture))
                # What has arrived by now: the rest comes with the next picture.
                while select.select([receiver], [], [], 0)[0]:
                    yield receiver.recv(2048)


def _serve(connection: socket.socket, frames: list[NDArray[np.uint8]], rate: int, over: threading.Event) -> None:
    """Answer one client, and send it packets once it wants to play."""
    host, port = connection.getsockname()
    sdp = (
        f"v=0\r\no=- 0 0 IN IP4 {host}\r\ns=test\r\nc=IN IP4 {host}\r\nt=0 0\r\n"
        f"m=video 0 RTP/AVP {PAYLOAD}\r\na=rtpmap:{PAYLOAD} H264/90000\r\na=fmtp:{PAYLOAD} packetization-mode=1\r\n"
        "a=control:track1\r\n"
    )
    with connection, connection.makefile("rb") as asked:
        while True:
            lines = list[str]()
            while (line := asked.readline().decode().strip()) or not lines:
                if not line:
                    return
                lines.append(line)
            method = lines[0].split()[0]
            headers = dict(each.split(": ", 1) for each in lines[1:])
            answer = [f"RTSP/1.0 200 OK\r\nCSeq: {headers['CSeq']}"]
            if method == "OPTIONS":
                answer.append("Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN")
            elif method == "DESCRIBE":
                answer += [f"Content-Base: rtsp://{host}:{port}/live/", "Content-Type: application/sdp"]
                answer.append(f"Content-Length: {len(sdp)}")
            elif method == "SETUP":
                assert "interleaved=0-1" in headers["Transport"], "asked for by UDP"
                answer += ["Transport: RTP/AVP/TCP;unicast;interleaved=0-1", "Session: 1"]
            else:
                answer.append("Session: 1")
            connection.sendall(("\r\n".join(answer) + "\r\n\r\n" + (sdp if method == "DESCRIBE" else "")).encode())
            if method == "PLAY":
                break
        try:
            for packet in rtp_packets(frames, rate, over):
                connection.sendall(b"$\x00" + len(packet).to_bytes(2, "big") + packet)
        except ConnectionError:
            return  # the client has closed the connection, which is how it ends a stream that has no end


@contextmanager
def rtsp_served(frames: list[NDArray[np.uint8]], rate: int) -> Iterator[str]:
    """The address of a server of frames, played again and again to one client after the other."""
    over = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def accept() -> None:
            while not over.is_set():
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                _serve(connection, frames, rate, over)

        thread = threading.Thread(target=accept, daemon=True)
        thread.start()
        yield f"rtsp://me:secret@127.0.0.1:{server.getsockname()[1]}/live"
        over.set()
        server.shutdown(socket.SHUT_RDWR)
    thread.join(5)
