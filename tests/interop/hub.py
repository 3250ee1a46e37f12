"""What an autopilot with several ports does: frames of each link go to all the others."""

import socket
import threading


class Hub:
    """Between a vehicle on TCP and any number of stations that connect to `port`."""

    def __init__(self, vehicle_port):
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.links, self.lock = [], threading.Lock()
        self.add(socket.create_connection(("127.0.0.1", vehicle_port)))
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                link, _ = self.listener.accept()
            except OSError:
                return
            self.add(link)

    def add(self, link):
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with self.lock:
            self.links.append(link)
        threading.Thread(target=self.forward, args=(link,), daemon=True).start()

    def forward(self, link):
        rest = b""
        while True:
            try:
                more = link.recv(4096)
            except OSError:
                more = b""
            if not more:
                with self.lock:
                    self.links = [other for other in self.links if other is not link]
                link.close()
                return
            rest = self.pass_on(link, rest + more)

    def pass_on(self, link, data):
        """Whole frames only: those of two links must not mix. What is left waits for more."""
        while True:
            starts = [k for k in (data.find(b"\xfd"), data.find(b"\xfe")) if k >= 0]
            if not starts:
                return b""
            data = data[min(starts):]
            if len(data) < 3:
                return data
            if data[0] == 0xFD:
                length = 12 + data[1] + (13 if data[2] & 1 else 0)
            else:
                length = 8 + data[1]
            if len(data) < length:
                return data
            frame, data = data[:length], data[length:]
            with self.lock:
                others = [other for other in self.links if other is not link]
            for other in others:
                try:
                    other.sendall(frame)
                except OSError:
                    pass

    def close(self):
        # Wakes the threads that wait; they close.
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        with self.lock:
            for link in self.links:
                try:
                    link.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass  # The other end was faster.
