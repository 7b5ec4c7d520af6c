"""An XRCE agent: a core without sockets and clock, and a UDP server around it."""
