"""The path between one node and the agent. Faults of the path outlive the node's sessions: a cable stays cut."""

from __future__ import annotations

from nros_backends.xrce.client.transport import Transport, open_socket
from nros_backends.xrce.proxy import FREE, Proxy, Rules


class Attachment:
    """One transport on the path, with its proxy once there is one. Used by the thread of its session."""

    def __init__(self, transport: Transport, link: Link) -> None:
        self.transport = transport
        self.link = link
        self._proxy: Proxy | None = None

    def proxy(self) -> Proxy:
        """The proxy that it leads through from now on; the agent sees the same endpoint as before."""
        if self._proxy is None:
            self._proxy = Proxy(self.transport.socket, self.link.out, self.link.into)
            self.transport.use(self._proxy.client)
        return self._proxy

    def close(self) -> None:
        """Close transport and proxy. A second call is harmless."""
        self.link.forget(self)
        self.transport.close()
        if self._proxy is not None:
            self._proxy.close()

    def obey(self, out: Rules, into: Rules) -> None:
        """Treat datagrams by these rules from now on."""
        if self._proxy is not None or (out, into) != (FREE, FREE):
            self.proxy().rule(out, into)


class Link:
    """All that one node sends to the agent and gets from it, and the rules for both directions."""

    def __init__(self, agent: tuple[str, int]) -> None:
        self.agent = agent
        self.out = FREE
        self.into = FREE
        self._attachments: list[Attachment] = []

    def open(self) -> Attachment:
        """A new transport; raises OSError."""
        attachment = Attachment(Transport(open_socket(self.agent)), self)
        self._attachments.append(attachment)
        attachment.obey(self.out, self.into)
        return attachment

    def rule(self, out: Rules, into: Rules) -> None:
        """Have other rules from now on; on the thread of the node's session."""
        self.out, self.into = out, into
        for attachment in self._attachments:
            attachment.obey(out, into)

    def forget(self, attachment: Attachment) -> None:
        """It is being closed."""
        if attachment in self._attachments:
            self._attachments.remove(attachment)
