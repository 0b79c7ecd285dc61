"""Limits for clients of the OPC UA server, as asyncua has none of its own: nodes a request, items, sessions.

A request beyond a limit gets the standard's status code, such as BadTooManyOperations, and changes nothing.
A session ends with its connection, and nobody uses the subscriptions of another session.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.internal_subscription import InternalSubscription
from asyncua.server.server import Server
from asyncua.ua.object_ids import ObjectIds
from asyncua.ua.status_codes import StatusCodes

from observer.outlets.opcua_history import MOST_VALUES, check_continuation_point

MOST_NODES = 1000
"""Of a request to read, translate, call, or create items."""
MOST_BROWSED = 100
"""Of a request to browse."""
MOST_HISTORIES = 100
"""Of a request to read history."""
_LEAST_VALUES = 50  # of a node, where many histories are read at once
MOST_REFERENCES = 2000
"""Of an answer to a request to browse; the nodes beyond get BadNoContinuationPoints."""
MOST_SESSIONS = 60
MOST_SUBSCRIPTIONS = 10
"""Of a session."""
MOST_ITEMS = 1000
"""Monitored, of a session."""
MOST_ITEMS_IN_ALL = 3000
_MOST_SUBSCRIPTIONS_IN_ALL = 100
_SESSION_MS = 60_000.0
_LEAST_PUBLISHING_MS, _MOST_PUBLISHING_MS = 100.0, 60_000.0
_MOST_LIFETIME, _MOST_KEEP_ALIVE = 600, 200  # publishing intervals
_MOST_QUEUED, _MOST_UNACKNOWLEDGED = 20, 20
_LIMITS = {
    ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerRead: MOST_NODES,
    ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerBrowse: MOST_BROWSED,
    ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerHistoryReadData: MOST_HISTORIES,
    ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerMethodCall: MOST_NODES,
    ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerTranslateBrowsePathsToNodeIds: MOST_NODES,
    ObjectIds.Server_ServerCapabilities_OperationLimits_MaxMonitoredItemsPerCall: MOST_NODES,
}


def limit(iserver: InternalServer) -> None:
    """Set the limits for which asyncua has settings; before the server starts."""
    iserver.max_session_timeout_ms = _SESSION_MS
    iserver.max_subscriptions = _MOST_SUBSCRIPTIONS_IN_ALL
    iserver.max_lifetime_count, iserver.max_keep_alive_count = _MOST_LIFETIME, _MOST_KEEP_ALIVE
    iserver.max_monitored_item_queue_size = _MOST_QUEUED
    iserver.max_unacked_messages_per_subscription = _MOST_UNACKNOWLEDGED


async def announce_limits(server: Server) -> None:
    """Write the limits where clients look for them (part 5, 6.3.11)."""
    for number, most in _LIMITS.items():
        node = server.get_node(ua.NodeId(ua.Int32(number)))
        await node.write_value(ua.Variant(most, ua.VariantType.UInt32))


class LimitedSession(InternalSession):
    """A session of a client. Its services raise `ServiceError` beyond a limit."""

    async def read(self, params: ua.ReadParameters) -> list[ua.DataValue]:
        """Read attributes."""
        _check(params.NodesToRead)
        return await super().read(params)

    async def browse(self, params: ua.BrowseParameters) -> list[ua.BrowseResult]:
        """Browse nodes, up to a number of references in all."""
        _check(params.NodesToBrowse, MOST_BROWSED)
        count, results = 0, list[ua.BrowseResult]()
        for description in params.NodesToBrowse:
            one = ua.BrowseParameters(View=params.View, NodesToBrowse=[description])
            (result,) = await super().browse(one)
            if results and count + len(result.References) > MOST_REFERENCES:
                status = ua.StatusCode(ua.UInt32(StatusCodes.BadNoContinuationPoints))
                result = ua.BrowseResult(StatusCode=status)
            count += len(result.References)
            results.append(result)
        return results

    async def translate_browsepaths_to_nodeids(
        self, params: list[ua.BrowsePath]
    ) -> list[ua.BrowsePathResult]:
        """Translate paths."""
        _check(params)
        return await super().translate_browsepaths_to_nodeids(params)

    async def history_read(self, params: ua.HistoryReadParameters) -> list[ua.HistoryReadResult]:
        """Read histories, which share the values of one answer; an error concerns its node alone."""
        _check(params.NodesToRead, MOST_HISTORIES)
        count, details = len(params.NodesToRead), params.HistoryReadDetails
        if isinstance(details, ua.ReadRawModifiedDetails) and count > 1:
            most = max(_LEAST_VALUES, MOST_VALUES // count)
            details.NumValuesPerNode = ua.Counter(min(details.NumValuesPerNode or most, most))
        return [await self._history_of(node, params) for node in params.NodesToRead]

    async def _history_of(
        self, node: ua.HistoryReadValueId, params: ua.HistoryReadParameters
    ) -> ua.HistoryReadResult:
        """Read the history of one node of a request."""
        details = params.HistoryReadDetails
        try:
            if node.ContinuationPoint and isinstance(details, ua.ReadRawModifiedDetails):
                check_continuation_point(node.ContinuationPoint, details)
            (result,) = await super().history_read(replace(params, NodesToRead=[node]))
        except ServiceError as error:
            result = ua.HistoryReadResult(StatusCode=ua.StatusCode(ua.UInt32(error.code)))
        return result

    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        """Call methods."""
        _check(params)
        return await super().call(params)

    async def create_subscription(
        self,
        params: ua.CreateSubscriptionParameters,
        callback: Callable[..., Any],
        request_callback: Callable[..., Any] | None = None,
    ) -> ua.CreateSubscriptionResult:
        """Create a subscription, with a publishing interval within bounds."""
        if len(self._subscriptions()) >= MOST_SUBSCRIPTIONS:
            raise ServiceError(StatusCodes.BadTooManySubscriptions)
        interval_ms = params.RequestedPublishingInterval
        if not interval_ms >= _LEAST_PUBLISHING_MS:  # also NaN
            interval_ms = _LEAST_PUBLISHING_MS
        params.RequestedPublishingInterval = ua.Duration(min(interval_ms, _MOST_PUBLISHING_MS))
        return await super().create_subscription(params, callback, request_callback)

    async def create_monitored_items(
        self, params: ua.CreateMonitoredItemsParameters
    ) -> list[ua.MonitoredItemCreateResult]:
        """Monitor items in a subscription of this session."""
        _check(params.ItemsToCreate)
        self._check_owner(params.SubscriptionId)
        count = len(params.ItemsToCreate)
        in_all = self.subscription_service.subscriptions.values()
        if count + _items(self._subscriptions()) > MOST_ITEMS or count + _items(in_all) > MOST_ITEMS_IN_ALL:
            raise ServiceError(StatusCodes.BadTooManyMonitoredItems)
        return await super().create_monitored_items(params)

    async def modify_monitored_items(
        self, params: ua.ModifyMonitoredItemsParameters
    ) -> list[ua.MonitoredItemModifyResult]:
        """Change monitored items of this session, with queues within bounds."""
        _check(params.ItemsToModify)
        self._check_owner(params.SubscriptionId)
        for item in params.ItemsToModify:
            size = item.RequestedParameters.QueueSize
            item.RequestedParameters.QueueSize = ua.Counter(min(size or _MOST_QUEUED, _MOST_QUEUED))
        return await super().modify_monitored_items(params)

    async def delete_monitored_items(self, params: ua.DeleteMonitoredItemsParameters) -> list[ua.StatusCode]:
        """Delete monitored items of this session."""
        _check(params.MonitoredItemIds)
        self._check_owner(params.SubscriptionId)
        return await super().delete_monitored_items(params)

    async def set_monitoring_mode(self, params: ua.SetMonitoringModeParameters) -> list[ua.StatusCode]:
        """Change the mode of monitored items of this session."""
        _check(params.MonitoredItemIds)
        self._check_owner(params.SubscriptionId)
        return await super().set_monitoring_mode(params)

    async def set_publishing_mode(self, params: ua.SetPublishingModeParameters) -> list[ua.StatusCode]:
        """Change the mode of subscriptions of this session."""
        for number in params.SubscriptionIds:
            self._check_owner(number)
        return await super().set_publishing_mode(params)

    async def delete_subscriptions(self, ids: list[int]) -> list[ua.StatusCode]:
        """Delete subscriptions of this session."""
        owned = [s.data.SubscriptionId for s in self._subscriptions() if s.data.SubscriptionId in ids]
        results = dict(zip(owned, await super().delete_subscriptions(owned), strict=True))
        unknown = ua.StatusCode(ua.UInt32(StatusCodes.BadSubscriptionIdInvalid))
        return [results.get(number, unknown) for number in ids]

    def modify_subscription(self, params: ua.ModifySubscriptionParameters) -> ua.ModifySubscriptionResult:
        """Answer with the parameters of a subscription of this session."""
        self._check_owner(params.SubscriptionId)
        return super().modify_subscription(params)

    def republish(self, params: ua.RepublishParameters) -> ua.NotificationMessage:
        """Give a notification of this session again."""
        self._check_owner(params.SubscriptionId)
        return super().republish(params)

    async def transfer_subscriptions(self, *_: Any) -> list[ua.TransferResult]:
        """Refuse: a subscription ends with its session."""
        raise ServiceError(StatusCodes.BadServiceUnsupported)

    def _subscriptions(self) -> list[InternalSubscription]:
        subscriptions = self.subscription_service.subscriptions.values()
        return [subscription for subscription in subscriptions if subscription.session_id == self.session_id]

    def _check_owner(self, number: int) -> None:
        subscription = self.subscription_service.subscriptions.get(number)
        if subscription is None or subscription.session_id != self.session_id:
            raise ServiceError(StatusCodes.BadSubscriptionIdInvalid)


def _check(operations: Iterable[Any], most: int = MOST_NODES) -> None:
    """Raise `ServiceError` where a request has more operations than the limit."""
    if len(list(operations or ())) > most:
        raise ServiceError(StatusCodes.BadTooManyOperations)


def _items(subscriptions: Iterable[InternalSubscription]) -> int:
    return sum(len(s.monitored_item_srv._monitored_items) for s in subscriptions)
