"""A connection to the broker that comes back by itself: MQTT 5 by paho, in a thread of its own."""

from __future__ import annotations

import logging
import secrets
import socket
import ssl
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from dtbacklash.errors import UserError
from dtbacklash.remote.credentials import PROPERTY, Credentials, Key

if TYPE_CHECKING:
    import paho.mqtt.client as mqtt

log = logging.getLogger(__name__)

#: seconds between two tries to reach a broker that is gone: the first, the longest
RETRY_S, RETRY_MAX_S = 0.1, 3.0
CONNECT_S, KEEP_ALIVE_S = 5.0, 20
#: for so long the broker keeps what it has for a client that was cut off
KEPT_S = 120
#: the broker does not hand over what is larger, nor more at a time than these
PACKET_BYTES, AT_A_TIME = 5_000_000, 50
HERE = ("localhost", "127.", "::1")
CLOSE_S = 1.0
#: what the broker says about a message on a topic without subscribers
NOBODY = "no matching subscribers"
EXTRA = "needs paho-mqtt: pip install 'dtbacklash[remote]'"

Take = Callable[[str, bytes, str | None], None]


class Connection:
    """A client of the broker at ``broker``.

    broker : host:port; ``setting`` is its name in errors. subscribe : topics. take : called in the network's thread
        with topic, payload and signature of each message. name : of the client, at the broker. published : called there
        with the number of a message and what the broker has against it, or "". changed : called there when the
        connection has come or gone. will : topic, payload and signature of what the broker publishes, retained, should
        this client be cut off. retained : whether to take what the broker has kept from before. kept_s : for how
        long the broker keeps what comes for this client while it is cut off.

    Raises UserError: no address; the extra is not installed; a certificate that cannot be read.
    """

    def __init__(
        self,
        broker: str,
        credentials: Credentials,
        subscribe: list[str],
        take: Take,
        name: str,
        setting: str = "broker",
        published: Callable[[int, str], None] | None = None,
        changed: Callable[[], None] | None = None,
        will: tuple[str, bytes, str] | None = None,
        retained: bool = False,
        kept_s: int = KEPT_S,
    ) -> None:
        self.broker, self.setting = broker, setting
        self.host, self.port = address(broker, setting)
        self._subscribe, self._take, self._retained, self._kept_s = subscribe, take, retained, kept_s
        self._published, self._changed = published, changed
        self.connected = threading.Event()
        #: of the last failure, in words; refused: the broker is there, and does not want this client
        self.problem, self.refused = "", False
        self.answered = threading.Event()
        self._client = self._made(credentials, name, will)

    def open(self) -> None:
        """Begin to connect; returns at once."""
        bounds = _properties(
            "CONNECT", SessionExpiryInterval=self._kept_s, MaximumPacketSize=PACKET_BYTES, ReceiveMaximum=AT_A_TIME
        )  # fmt: skip
        self._client.connect_async(self.host, self.port, KEEP_ALIVE_S, properties=bounds)
        self._client.loop_start()

    def publish(
        self, topic: str, payload: bytes, key: Key, retain: bool = False, expires_s: float | None = None
    ) -> int:
        """Hand a signed message to the network's thread; its number, as ``published`` names it."""
        properties = _properties("PUBLISH", UserProperty=(PROPERTY, key.sign(topic, payload)))
        if expires_s is not None:
            properties.MessageExpiryInterval = max(1, round(expires_s))
        return int(self._client.publish(topic, payload, qos=1, retain=retain, properties=properties).mid)

    def close(self) -> None:
        """End it, within a second even where the network is dead."""
        self._changed = None  # that it is gone is no news
        self._client.disconnect(properties=_properties("DISCONNECT", SessionExpiryInterval=0))  # nothing is kept
        # paho waits for what is not acknowledged
        ending = threading.Thread(target=self._client.loop_stop, daemon=True)
        ending.start()
        ending.join(CLOSE_S)

    def _made(self, credentials: Credentials, name: str, will: tuple[str, bytes, str] | None) -> mqtt.Client:
        try:
            import fastjsonschema as _schemas  # noqa: F401 - what is taken here is checked with it
            import paho.mqtt.client as mqtt
            from paho.mqtt.enums import CallbackAPIVersion
        except ImportError as error:
            raise UserError(self.setting, self.broker, EXTRA) from error
        client = mqtt.Client(
            CallbackAPIVersion.VERSION2, client_id=f"{name}-{secrets.token_hex(4)}", protocol=mqtt.MQTTv5
        )
        client.reconnect_delay_set(RETRY_S, RETRY_MAX_S)  # type: ignore[arg-type]
        client.connect_timeout = CONNECT_S
        # else the last part of a message waits for the acknowledgement of the first: 40 ms
        client.on_socket_open = _at_once
        client.max_queued_messages_set(1000)
        if credentials.user is not None:
            client.username_pw_set(credentials.user, credentials.password)
            if credentials.ca_file is None and not self.host.startswith(HERE):
                log.warning("the password goes to %s unencrypted: give ca_file in the credentials", self.host)
        if credentials.ca_file is not None or credentials.cert_file is not None:
            try:
                client.tls_set(credentials.ca_file, credentials.cert_file, credentials.cert_key_file)
            except (OSError, ValueError) as error:
                raise UserError("credentials", credentials.ca_file, f"no certificates: {error}") from error
        if will is not None:
            topic, payload, signature = will
            properties = _properties("WILLMESSAGE", UserProperty=(PROPERTY, signature))
            client.will_set(topic, payload, qos=1, retain=True, properties=properties)
        client.on_connect, client.on_connect_fail = self._on_connect, self._on_connect_fail
        client.on_disconnect, client.on_message, client.on_publish = (
            self._on_disconnect, self._on_message, self._on_publish,
        )  # fmt: skip
        return client

    def _on_connect(self, client: mqtt.Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            self.problem, self.refused = str(reason).lower(), True
        else:
            self.problem, self.refused = "", False
            for topic in self._subscribe:
                client.subscribe(topic, qos=1)
            self.connected.set()
        self.answered.set()
        self._tell()

    def _on_connect_fail(self, _client: mqtt.Client, _data: Any) -> None:
        self.problem = why_not(sys.exc_info()[1])  # paho calls this while it handles the error
        self.connected.clear()
        self.answered.set()
        self._tell()

    def _on_disconnect(self, _client: mqtt.Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        self.connected.clear()
        if not self.refused:
            self.problem = f"connection lost: {str(reason).lower()}"
        self._tell()

    def _on_message(self, _client: mqtt.Client, _data: Any, message: mqtt.MQTTMessage) -> None:
        if message.retain and not self._retained:
            log.info("dropped: kept by the broker from before, on %s", message.topic)
            return
        pairs = getattr(message.properties, "UserProperty", [])
        signature = next((value for name, value in pairs if name == PROPERTY), None)
        self._take(message.topic, bytes(message.payload), signature)

    def _on_publish(self, _client: mqtt.Client, _data: Any, mid: int, reason: Any, _properties: Any) -> None:
        if self._published is not None:
            # 16: nobody has subscribed
            said = str(reason).lower() if reason.is_failure or reason.value == 16 else ""
            self._published(mid, said)

    def _tell(self) -> None:
        if self._changed is not None:
            self._changed()


def why_not(error: BaseException | None) -> str:
    """Why a broker cannot be reached, in words."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate does not hold: {error.verify_message}"
    if isinstance(error, ssl.SSLError):
        return f"it does not speak TLS as the credentials want it: {(error.reason or str(error)).lower()}"
    if isinstance(error, socket.gaierror):
        return "there is no such host"
    if isinstance(error, ConnectionRefusedError):
        return "nothing listens there (connection refused)"
    if isinstance(error, TimeoutError):
        return f"it does not answer within {CONNECT_S:g} s"
    return (getattr(error, "strerror", None) or str(error or "it cannot be reached")).lower()


def address(text: str, key: str) -> tuple[str, int]:
    """Host and port from ``host:port``, ``host`` or ``[::1]:port``; raises UserError."""
    host, colon, port = text.rpartition(":")
    if not colon or (":" in host and not host.startswith("[")):
        host, port = text, "1883"
    host = host.strip("[]")
    if not host or not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise UserError(key, text, "host:port, e.g. 127.0.0.1:1883")
    return host, int(port)


def _at_once(_client: mqtt.Client, _data: Any, link: Any) -> None:
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def _properties(packet: str, **values: Any) -> Any:
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties

    properties: Any = Properties(getattr(PacketTypes, packet))  # type: ignore[no-untyped-call]
    for name, value in values.items():
        setattr(properties, name, value)
    return properties
