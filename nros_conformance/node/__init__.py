"""The application API of the seed documents, in Python dress: executor, entities with callbacks and awaits.

>>> from nros_conformance.node import Context, Executor
>>> with Context("uorb") as context:
...     node = context.create_node("bridge")
...     subscription = node.create_subscription("std_msgs/msg/String", "/chatter")
...     subscription.on_message_lost(lambda status: print("dropped", status.total_count_change))
...     code = Executor(node).spin_once()
>>> code
0
"""

from nros_conformance.node.context import Context
from nros_conformance.node.entities import Publisher, Subscription
from nros_conformance.node.errors import UnsupportedError
from nros_conformance.node.executor import Executor
from nros_conformance.node.node import Node
from nros_conformance.node.reconnection import LinkState, Pace, Reconnector, Transition

__all__ = [
    "Context", "Executor", "LinkState", "Node", "Pace", "Publisher", "Reconnector", "Subscription", "Transition",
    "UnsupportedError",
]  # fmt: skip
