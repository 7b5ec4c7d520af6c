"""Networks on loopback: which DDS domain and ports a session gets, and its configuration.

Every session has a `Domain` object of its own, with its own sockets and threads; those that shall meet
have the same *external* domain id. Discovery is by multicast on ``lo``, on a port inside the leased
range; unicast ports are ephemeral ("ParticipantIndex none"), so the kernel sees to it that they are
free. The kernel lets all members of a multicast group bind the port, also of different runs: what
keeps those apart is the leased range, and within a run the external domain id, which Cyclone compares
before it accepts a participant.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import threading
from collections.abc import Iterator

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.qos import Policy, Qos

from nros_backends.cyclone.ear import Ear
from nros_conformance.rmw.codes import ReturnCode, RmwError

LEASE_MS = 10_000
"""Default lease of a session (its participant), as Cyclone's own: after that a crashed one is forgotten."""

_ANNOUNCE_MS = 250
"""How often a participant announces itself at least, so that those who missed one soon have the next."""

LEASE_MAX_MS = 3_600_000
"""The longest that Cyclone's configuration takes: an hour."""

DOMAINS = 2
"""A scenario's own domain and its neighbour."""

_DEFAULT_PORTS = range(7400, 7650)
"""Without a lease: where RTPS' domain 0 lies."""

_PORTS_EACH = 2
"""Multicast discovery, and multicast data, which is never sent but has a socket."""

_PORT_TRIES = 8

ONE_DOMAIN_AT_A_TIME = threading.Lock()
"""Held while a domain is created or deleted, by all backends of the process: two threads that do so at once
corrupt libddsc 11.0.1's tree of domains (a segfault in dds_create_domain, once in some 3,000 sessions;
benchmarks/endurance.py shows it without this lock). No upstream issue was found."""

_CONFIGURATION = """\
<CycloneDDS><Domain Id="any">
  <General>
    <Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces>
    <AllowMulticast>spdp</AllowMulticast>
  </General>
  <Discovery>
    <ExternalDomainId>{external_id}</ExternalDomainId>
    <LeaseDuration>{lease_ms}ms</LeaseDuration>
    <SPDPInterval>{announce_ms}ms</SPDPInterval>
    <Ports>
      <Base>{port}</Base>
      <DomainGain>0</DomainGain>
      <MulticastMetaOffset>0</MulticastMetaOffset>
      <MulticastDataOffset>1</MulticastDataOffset>
    </Ports>
  </Discovery>
  <Internal>
    <WriterLingerDuration>20ms</WriterLingerDuration>
    <PreEmptiveAckDelay>1ms</PreEmptiveAckDelay>
  </Internal>
</Domain></CycloneDDS>
"""
# SPDPInterval: four announcements per lease, where Cyclone's own 80 % leaves a busy host one try.
# WriterLingerDuration: a destroy waits that long for acknowledgements, which healthy readers send about
# every 100 ms. The default of 1 s adds up over the writers of a session, and a short manual lease
# expires meanwhile, so that an orderly destroy looks like a loss first.
# PreEmptiveAckDelay: how soon a reader asks a new writer for its first heartbeat, see `await_matched`.


@dataclasses.dataclass(frozen=True, slots=True)
class Network:
    """The place of one scenario: its number among those alive at once, and the ports leased."""

    number: int
    ports: range

    def external_id(self, domain_id: int) -> int:
        """The DDS domain id on the wire, unique within a run."""
        return self.number * DOMAINS + domain_id

    def port_candidates(self, domain_id: int) -> Iterator[int]:
        """Ports to try in this order, the same for all sessions that shall meet."""
        ports = self.ports if len(self.ports) >= _PORTS_EACH else _DEFAULT_PORTS
        places = len(ports) // _PORTS_EACH
        first = self.external_id(domain_id) % places
        # Another network's port is a good substitute: the external id tells them apart.
        for step in range(min(_PORT_TRIES, places)):
            yield ports[(first + step) % places * _PORTS_EACH]

    def configuration(self, domain_id: int, port: int, lease_ms: int) -> str:
        """Cyclone's configuration for one session, XML."""
        return _CONFIGURATION.format(
            external_id=self.external_id(domain_id),
            lease_ms=lease_ms,
            port=port,
            announce_ms=min(max(lease_ms // 4, 20), _ANNOUNCE_MS),
        )

    def join(
        self, domain_id: int, node_name: str, lease_ms: int, *, hears: bool = False
    ) -> tuple[Domain, DomainParticipant, Ear | None]:
        """A new domain object with one participant. Both end with their last reference, the domain last.

        ``hears``: with an ear that has heard it from its first announcement on. Raises `RmwError`
        CONNECTION_FAILED when none of the ports can be had.
        """
        problem = ""
        for port in self.port_candidates(domain_id):
            with contextlib.ExitStack() as undo:
                try:
                    ear = undo.enter_context(contextlib.closing(Ear(port))) if hears else None
                    domain, local_id = self._domain(self.configuration(domain_id, port, lease_ms))
                    participant = DomainParticipant(local_id, Qos(Policy.EntityName(node_name)))
                except (DDSException, OSError) as error:
                    problem = str(error)
                else:
                    undo.pop_all()
                    return domain, participant, ear
        raise RmwError(ReturnCode.CONNECTION_FAILED, problem)

    def _domain(self, configuration: str) -> tuple[Domain, int]:
        """Local domain ids have to be unique in this process; a taken one costs 2 us, so try."""
        for local_id in itertools.count(1 + self.number % 1_000 * 16):
            try:
                with ONE_DOMAIN_AT_A_TIME:
                    return Domain(local_id, configuration), local_id
            except DDSException as error:
                if error.code != DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
                    raise
        raise AssertionError("itertools.count ended")
