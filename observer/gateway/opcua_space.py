"""What OPC UA itself defines (namespace 0, part 5 of the standard), as far as this server has a use for it.

asyncua makes all of its 6,000 nodes, in 50 MB: those of alarms, certificates, files, publishers, roles and
state machines too, of which none are here. Left are the server's own object, the base types and the data
types, without what describes their encodings, which clients know.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator

from asyncua import server as package
from asyncua import ua
from asyncua.server.address_space import NodeManagementService
from asyncua.ua.object_ids import ObjectIds

_SPACE = "standard_address_space"
_IDS = ObjectIds
_UNUSED = {
    _IDS.BaseEventType, _IDS.OpcUa_XmlSchema, _IDS.OpcUa_BinarySchema, _IDS.ServerConfiguration,
    _IDS.Server_ServerCapabilities_RoleSet, _IDS.PublishSubscribe,
}  # fmt: skip
_USED_KINDS_OF_OBJECTS = {
    _IDS.FolderType, _IDS.ServerType, _IDS.ServerCapabilitiesType, _IDS.ServerDiagnosticsType,
    _IDS.SessionsDiagnosticsSummaryType, _IDS.SessionDiagnosticsObjectType, _IDS.VendorServerInfoType,
    _IDS.ServerRedundancyType, _IDS.OperationLimitsType, _IDS.DataTypeSystemType, _IDS.DataTypeEncodingType,
    _IDS.ModellingRuleType, _IDS.AggregateFunctionType, _IDS.NamespaceMetadataType, _IDS.NamespacesType,
}  # fmt: skip


def fill(service: NodeManagementService) -> None:
    """Make the nodes, and give up the code that describes them all, 16 MB."""
    from asyncua.server.standard_address_space.standard_address_space import (  # noqa: PLC0415
        fill_address_space,
    )

    fill_address_space(_Chosen(service))  # type: ignore[no-untyped-call]
    for name in [name for name in sys.modules if name.startswith(f"{package.__name__}.{_SPACE}")]:
        del sys.modules[name]
    delattr(package, _SPACE)


class _Chosen:
    """Adds the nodes that are used, and the references between them."""

    def __init__(self, service: NodeManagementService) -> None:
        self._service = service
        self._left_out: set[ua.NodeId] = set()

    def try_add_nodes(
        self, items: Iterable[ua.AddNodesItem], *, check: bool = True
    ) -> Iterator[ua.AddNodesItem]:
        """Add nodes; yields those that something not there yet is wanted for."""
        return self._service.try_add_nodes([item for item in items if self._is_used(item)], check=check)

    def try_add_references(self, items: Iterable[ua.AddReferencesItem]) -> Iterator[ua.AddReferencesItem]:
        """Add references; yields those whose source is not there yet."""
        return self._service.try_add_references(
            [item for item in items if not {item.SourceNodeId, item.TargetNodeId} & self._left_out]
        )

    def _is_used(self, item: ua.AddNodesItem) -> bool:
        """Whether a node is wanted; what is below one that is not, or is of its type, is not either."""
        node, parent = item.RequestedNewNodeId, item.ParentNodeId
        used = not (
            node.Identifier in _UNUSED
            or item.ReferenceTypeId.Identifier == _IDS.HasEncoding
            or {parent, item.TypeDefinition} & self._left_out
            or (
                parent.Identifier == _IDS.BaseObjectType
                and item.NodeClass == ua.NodeClass.ObjectType
                and node.Identifier not in _USED_KINDS_OF_OBJECTS
            )
        )
        if not used:
            self._left_out.add(node)
        return used
