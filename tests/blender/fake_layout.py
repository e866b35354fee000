"""Stands in for a panel's layout where there is no window: checks what is asked, and notes it.

Everything is looked up in this Blender's own description of layouts, properties and operators.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy

_RNA = bpy.types.UILayout.bl_rna
_ICONS = set(_RNA.functions["label"].parameters["icon"].enum_items.keys())
# Calls that return a layout to draw in.
_CONTAINERS = ("row", "column", "column_flow", "grid_flow", "box", "split")
# Keywords of Blender's Python layer, that its description of the functions lacks.
_EXTRA = {"text_ctxt", "translate"}


class Item:
    """Something that was drawn.

    Attributes:
        kind: the function's name: "label", "prop", "operator" ...
        text: shown; of an operator or property, its own name if the panel gives none.
        name: of the operator or property.
        values: what the panel sets on the operator.
        active: no layout around it is greyed out.
    """

    def __init__(self, kind: str, text: str, name: str, active: bool) -> None:
        self.kind, self.text, self.name, self.active = kind, text, name, active
        self.values: dict[str, Any] = {}

    def __repr__(self) -> str:
        return f"{self.kind}({self.name or self.text!r})"


class FakeLayout:
    """Takes what a UILayout of this Blender takes; raises AssertionError for anything else."""

    def __init__(self, items: list[Item], active: bool = True) -> None:
        object.__setattr__(self, "_items", items)
        object.__setattr__(self, "_active", active)

    def __setattr__(self, name: str, value: Any) -> None:
        described = _RNA.properties.get(name)
        assert described is not None and not described.is_readonly, f"no layout property {name!r}"
        assert isinstance(value, (bool, int, float, str)), f"{name} = {value!r}"
        if name in ("active", "enabled"):
            object.__setattr__(self, "_active", self._active and value)

    def __getattr__(self, name: str) -> Any:
        function = _RNA.functions.get(name)
        assert function is not None, f"a layout has no {name!r}"
        return lambda *args, **keywords: self._call(function, args, keywords)

    def _call(self, function: Any, args: tuple[Any, ...], keywords: dict[str, Any]) -> Any:
        kind = function.identifier
        taken = [each for each in function.parameters if not each.is_output]
        assert len(args) <= len(taken), f"{kind}: too many arguments"
        unknown = set(keywords) - {each.identifier for each in taken} - _EXTRA
        assert not unknown, f"{kind}: unknown keywords {unknown}"
        given = {each.identifier: value for each, value in zip(taken, args, strict=False)}
        assert not set(given) & set(keywords), f"{kind}: given twice"
        given |= keywords
        for each in taken:
            assert not each.is_required or each.identifier in given, f"{kind}: no {each.identifier}"
        assert given.get("icon", "NONE") in _ICONS, f"no icon {given['icon']!r}"
        text = given.get("text")
        assert text is None or isinstance(text, str), f"{kind}: text is {text!r}"
        if kind in _CONTAINERS:
            return FakeLayout(self._items, self._active)
        if kind == "prop":
            data, name = given["data"], given["property"]
            described = data.bl_rna.properties.get(name)
            assert described is not None, f"{data!r} has no property {name!r}"
            return self._note(kind, described.name if text is None else text, name)
        if kind == "operator":
            return self._operator(given["operator"], text)
        return self._note(kind, text or "", "")

    def _operator(self, name: str, text: str | None) -> Any:
        module, _, function = name.partition(".")
        assert function in dir(getattr(bpy.ops, module)), f"no operator {name!r}"
        described = getattr(getattr(bpy.ops, module), function).get_rna_type()
        item = self._note("operator", described.name if text is None else text, name)
        return _Values(item, described)

    def _note(self, kind: str, text: str, name: str) -> Item:
        item = Item(kind, text, name, self._active)
        self._items.append(item)
        return item


class _Values:
    """What an operator is called with."""

    def __init__(self, item: Item, described: Any) -> None:
        object.__setattr__(self, "_item", item)
        object.__setattr__(self, "_described", described)

    def __setattr__(self, name: str, value: Any) -> None:
        described = self._described.properties.get(name)
        assert described is not None, f"{self._item.name} has no property {name!r}"
        if described.type == "ENUM":
            assert value in described.enum_items, f"{name} has no item {value!r}"
        self._item.values[name] = value


class FakeContext:
    """The context, with some of it set by a test, as an editor would set it."""

    def __init__(self, **values: Any) -> None:
        self._values = values

    def __getattr__(self, name: str) -> Any:
        if name in self._values:
            return self._values[name]
        return getattr(bpy.context, name)


class _Self:
    """What `self` is to a panel."""

    def __init__(self, panel: type, layout: FakeLayout) -> None:
        self.layout = layout
        self.bl_label = panel.bl_label


def draw(panel: type, **context: Any) -> list[Item] | None:
    """What a panel shows; None if its poll hides it."""
    surroundings = FakeContext(**context)
    if hasattr(panel, "poll") and not panel.poll(surroundings):
        return None
    items: list[Item] = []
    fake = _Self(panel, FakeLayout(items))
    if hasattr(panel, "draw_header"):
        panel.draw_header(fake, surroundings)
    panel.draw(fake, surroundings)
    return items


def texts(items: list[Item]) -> Iterator[str]:
    """What is to be read."""
    return (item.text for item in items if item.text)
