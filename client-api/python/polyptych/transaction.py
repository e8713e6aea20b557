"""Changes of the open scene that belong together."""

from __future__ import annotations

from typing import Any, Dict, List, Optional, Union

from . import vectors
from .records import FilePath
from .scene import Attribute, attribute_to_json


class Transaction:
    """Changes of the scene that are seen from one frame on, on all displays, or not at all.

    ::

        transaction = Transaction()
        arm = transaction.create("arm", mesh=0)
        transaction.set_visible(3, False)
        edited = wall.commit(transaction)
        arm = edited.node(arm)
    """

    def __init__(self, base: Optional[int] = None, is_temporary: bool = False) -> None:
        """
        :param base: the revision that the program has seen. A node that was changed since is not
            changed again, and the transaction refused. ``None``: the last one wins.
        :param is_temporary: takes the nodes that it makes away when this client's connection ends.
        """
        self.base, self.is_temporary = base, is_temporary
        self.edits: List[Dict[str, Any]] = []
        self._creations = 0
        self._assets: Any = None

    def create(
        self,
        name: str = "",
        parent: Optional[int] = None,
        local: Any = None,
        mesh: Optional[int] = None,
        light: Any = None,
    ) -> int:
        """Makes a node. Returns its provisional number, which later edits can use.

        :param local: see :func:`polyptych.transform`; at the parent's origin if not given.
        :param mesh: an index into the meshes of the scene.
        """
        node = (1 << 63) + self._creations
        self._creations += 1
        new = {"parent": parent, "name": name, "mesh": mesh, "light": light}
        new["local"] = vectors.placed() if local is None else vectors.transform(local)
        return self._add("Create", node, {"new": new})

    def remove(self, node: int) -> None:
        """Takes a node away with all that hangs from it."""
        self.edits.append({"Remove": node})

    def set_parent(self, node: int, parent: Optional[int]) -> None:
        """Hangs a node from another, or from the scene itself; its transform stays as it is."""
        self._add("SetParent", node, {"parent": parent})

    def set_transform(self, node: int, local: Any) -> None:
        """Places a node in its parent's space; see :func:`polyptych.transform`."""
        self._add("SetTransform", node, {"local": vectors.transform(local)})

    def set_visible(self, node: int, visible: bool) -> None:
        """Shows a node with all that hangs from it, or does not."""
        self._add("SetVisible", node, {"visible": visible})

    def set_name(self, node: int, name: str) -> None:
        """Names a node."""
        self._add("SetName", node, {"name": name})

    def set_mesh(self, node: int, mesh: Optional[int]) -> None:
        """Gives a node another mesh of the scene, by its index, or none."""
        self._add("SetMesh", node, {"mesh": mesh})

    def set_light(self, node: int, light: Any) -> None:
        """Gives a node another light, in the form of the wire, or none."""
        self._add("SetLight", node, {"light": light})

    def set_attribute(self, node: int, key: str, value: Optional[Attribute]) -> None:
        """Notes something about a node; ``None`` forgets it."""
        self._add("SetAttribute", node, {"key": key, "value": attribute_to_json(value)})

    def set_layer(self, node: int, layer: Optional[str]) -> None:
        """Puts a node into a layer; ``None`` into that of its parent."""
        self._add("SetLayer", node, {"layer": layer})

    def set_layer_visible(self, layer: str, visible: bool) -> None:
        """Shows or hides all nodes of a layer, but in views that choose layers of their own."""
        self.edits.append({"SetLayerVisible": {"layer": layer, "visible": visible}})

    def set_switch(self, node: int, shown: Optional[int]) -> None:
        """Shows only one of the nodes that hang from a node; ``None`` for all."""
        self._add("SetSwitch", node, {"shown": shown})

    def set_style(self, node: int, style: Dict[str, Any]) -> None:
        """Draws a node in another way: ``fill``, ``shading``, ``highlight`` in the wire's form."""
        whole = {"fill": None, "shading": None, "highlight": None, **style}
        self._add("SetStyle", node, {"style": whole})

    def set_facing(self, node: int, facing: Optional[str]) -> None:
        """Lets a node turn towards the viewer: ``"Eye"``, ``"Upright"``, or not."""
        self._add("SetFacing", node, {"facing": facing})

    def set_variant(self, variant: Union[str, int, None]) -> None:
        """Shows a variant of the scene's file, by its name or its number; ``None`` for none."""
        self.edits.append({"SetVariant": None if variant is None else str(variant)})

    def set_material(self, material: int, to: Dict[str, Any]) -> None:
        """Gives a material of the scene, by its index, another look, in the form of the wire."""
        self.edits.append({"SetMaterial": {"material": material, "to": to}})

    def with_assets(
        self,
        *,
        glb: Optional[bytes] = None,
        file: Optional[FilePath] = None,
        below: Optional[Dict[str, Any]] = None,
    ) -> Transaction:
        """Brings meshes, materials and textures: the bytes of a ``.glb``, or a file's path.

        Bytes take about four times as many in JSON: files over 1 MiB go by their path, in one of
        the manager's scene folders.

        :param below: makes the file's own nodes too, below a node that is made for them, in the
            form of the wire: ``name`` and ``local`` (see :func:`placed`) and, where wanted,
            ``parent``, ``mesh`` and ``light``.
        :raises ValueError: neither or both are given.
        """
        if (glb is None) == (file is None):
            raise ValueError("give either glb or file")
        source: Any = {"File": file} if glb is None else {"Glb": list(glb)}
        self._assets = {"source": source, "below": below}
        return self

    def to_json(self) -> Any:
        """Returns the form of the wire."""
        return {
            "base": self.base,
            "edits": self.edits,
            "is_temporary": self.is_temporary,
            "assets": self._assets,
        }

    def _add(self, kind: str, node: int, members: Dict[str, Any]) -> int:
        self.edits.append({kind: {"node": node, **members}})
        return node


def provisional_asset(index: int) -> int:
    """Returns the number that stands in a transaction for the ``index``-th mesh that it brings."""
    return (1 << 31) + index
