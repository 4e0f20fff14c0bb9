"""Managed nodes (lifecycle): configured and active from the start, unless something else manages them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from functools import partial
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import ParameterDescriptor, ParameterType, SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from std_srvs.srv import Empty

from lrtrav_ros.nodes.parameters import Settings

_AUTOSTART = "configure and activate the node at its start; false where a lifecycle manager does"


class ManagedNode(LifecycleNode):
    """A managed node whose subclass says what it makes in each transition; what it made is destroyed with the reverse.

    Unconfigured it has its parameters; inactive its publishers, and its kernels are compiled; active its subscriptions
    too. The subclass calls `start` at the end of its ``__init__``. The service ``~/reset`` makes an active node forget
    what it has received.

    Parameters
    ----------
    name : str
        The node's name.
    stages : collection of str
        Whose parameters it has; see `Settings`.
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    ValueError
        If a parameter that it is started with does not fit.
    """

    def __init__(self, name: str, stages: Collection[str], **options: Any) -> None:
        super().__init__(name, **options)
        self._settings = Settings(self, stages)
        descriptor = ParameterDescriptor(description=_AUTOSTART, read_only=True)
        self._is_autostarted = bool(self.declare_parameter("autostart", True, descriptor).value)
        self._failure: Exception | None = None
        self._guard_transitions()
        self._guard_parameters()
        self._before: dict[str, set[Any]] = {}  # what there was before each transition that is in force

    @property
    def is_active(self) -> bool:
        """Whether the node takes frames."""
        return "activate" in self._before

    def start(self) -> None:
        """Configure and activate the node, unless ``autostart`` is false; raises what prevents that."""
        if not self._is_autostarted:
            self.get_logger().info("waits to be configured: autostart is false")
            return
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS and self._failure is not None:
                raise self._failure

    def configure(self) -> None:
        """Make the publishers, and all that takes time."""
        raise NotImplementedError

    def activate(self) -> None:
        """Make the subscriptions, and begin with the work at the end."""
        raise NotImplementedError

    def deactivate(self) -> None:
        """End the work; the subscriptions are destroyed afterwards."""
        raise NotImplementedError

    def forget(self) -> None:
        """Forget calibration, memory and statistics."""
        raise NotImplementedError

    def destroy_node(self) -> None:
        """End the work, then the node."""
        if self.is_active:
            del self._before["activate"]
            self.deactivate()
        super().destroy_node()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the transition to inactive."""
        return self._attempt("configure", self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the transition to active."""
        return self._attempt("activate", self.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the transition from active to inactive."""
        before = self._before.pop("activate")
        self.deactivate()
        self._destroy(self._entities() - before)
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the transition from inactive to unconfigured."""
        self._destroy(self._entities() - self._before.pop("configure"))
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the transition from any state to finalized."""
        if self.is_active:
            self.on_deactivate(state)
        if "configure" in self._before:
            self.on_cleanup(state)
        return TransitionCallbackReturn.SUCCESS

    def _guard_transitions(self) -> None:
        """Refuse transitions that the present state does not have, for which rclpy raises through the executor."""
        service = next(each for each in self.services if each.srv_name.endswith("/change_state"))
        change_state = service.callback

        def change_or_refuse(request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
            self._failure = None
            try:
                response = change_state(request, response)
            except RuntimeError as err:  # rclpy's RCLError, which has no public name
                self.get_logger().warning(f"transition refused: {err}")
                response.success = False
            if self._failure is not None:
                self.get_logger().error(f"transition failed: {self._failure}")
            return response

        service.callback = change_or_refuse

    def _guard_parameters(self) -> None:
        """Refuse values of types that ROS does not have, for which rclpy raises through the executor."""
        for service in self.services:
            if service.srv_name.endswith(("/set_parameters", "/set_parameters_atomically")):
                service.callback = partial(_set_or_refuse, service.callback)

    def _configure(self) -> None:
        self.configure()
        self.create_service(Empty, "~/reset", self._reset)

    def _reset(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        if self.is_active:
            self.forget()
            self.get_logger().info("reset: calibration, memory and statistics are forgotten")
        return response

    def _attempt(self, name: str, make: Callable[[], None]) -> TransitionCallbackReturn:
        """Make what a transition adds; where that fails nothing of it stays, and the node is in the state before."""
        before = self._entities()
        try:
            make()
        except Exception as err:  # rclpy would drop it without a word
            self._failure = err
            self._destroy(self._entities() - before)
            return TransitionCallbackReturn.FAILURE
        self._before[name] = before
        return TransitionCallbackReturn.SUCCESS

    def _entities(self) -> set[Any]:
        return {*self.publishers, *self.subscriptions, *self.services, *self.timers}

    def _destroy(self, entities: Iterable[Any]) -> None:
        """Destroy publishers, subscriptions, services and timers."""
        for destroy, own in (
            (self.destroy_publisher, self.publishers),
            (self.destroy_subscription, self.subscriptions),
            (self.destroy_service, self.services),
            (self.destroy_timer, self.timers),
        ):
            for entity in set(own) & set(entities):
                destroy(entity)


def _set_or_refuse(set_parameters: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
    """Answer a request of SetParameters or SetParametersAtomically."""
    unknown = [each for each in request.parameters if each.value.type > ParameterType.PARAMETER_STRING_ARRAY]
    if not unknown:
        return set_parameters(request, response)
    reason = f"{unknown[0].name} has a value of type {unknown[0].value.type}, which ROS does not have"
    refused = SetParametersResult(successful=False, reason=reason)
    if isinstance(response, SetParameters.Response):
        response.results = [refused] * len(request.parameters)
    else:
        response.result = refused
    return response
