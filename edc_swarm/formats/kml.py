"""KML 2.0 to 2.3, and KMZ (KML in a zip archive): placemarks with points, lines, tracks and polygons.

The standard library's parser reads it, with declarations of types and entities refused: a few of them can stand for
gigabytes. Prefixes of names are cut off, since many writers leave their declarations out.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import MAX_FILE_BYTES, Content, Options, check_lat_lon, parsed
from edc_swarm.formats.features import Feature, Shape, features_content, properties_of

MAX_ELEMENTS = 500_000
MAX_LEVELS = 100
MAX_ENTRIES = 1000
"""Most files in a KMZ archive."""
CONTAINERS = frozenset({"kml", "document", "folder"})
SIMPLE = {"point": "point", "linestring": "line", "linearring": "line"}
PARTS = frozenset({*CONTAINERS, *SIMPLE, "placemark", "polygon", "multigeometry", "multitrack", "track"})
PLAIN = frozenset(
    {"name", "visibility", "open", "extendeddata", "altitudemode", "extrude", "tessellate", "coordinates"}
)
"""Elements that are read, or that say nothing which a plane mission could express or lose."""
DRAWING = frozenset({"style", "stylemap", "styleurl", "lookat", "camera", "snippet", "address", "description"})
"""Elements that only describe and draw."""


@dataclass(slots=True)
class Node:
    """One element: its name in small letters, without prefix, and its line."""

    name: str
    line: int
    attributes: dict[str, str]
    text: list[str] = field(default_factory=list)
    children: list[Node] = field(default_factory=list)

    @property
    def content(self) -> str:
        """The text of the element itself."""
        return "".join(self.text).strip()

    def child(self, name: str) -> Node | None:
        """Return the child of this name; raise `FormatError` if there are two."""
        found = [child for child in self.children if child.name == name]
        if len(found) > 1:
            raise FormatError(f"line {found[1].line}", f"element {name}: must be there once in {self.name[:40]}")
        return found[0] if found else None

    def said(self, name: str) -> str:
        """Return the text of the child of this name, "" if there is none."""
        found = self.child(name)
        return found.content if found is not None else ""


def read_kml(data: bytes, options: Options) -> Content:
    """Return routes and zones of a KML file, or of a KMZ archive.

    Raises
    ------
    FormatError
    """
    notes = Content()
    root = _tree(_unpacked(data, notes) if data.startswith(b"PK") else data)
    if root.name not in {*CONTAINERS, "placemark"}:
        raise FormatError(f"line {root.line}", f"element {root.name[:40]}: must be kml")
    modes = list(_named(root, "altitudemode"))
    if len({mode.content for mode in modes}) > 1:
        notes.note("altitudes that count from different levels", *(f"line {mode.line}" for mode in modes))
    return features_content(list(_features(root, notes)), notes, options)


def _unpacked(data: bytes, notes: Content) -> bytes:
    """Return the KML file of a KMZ archive: doc.kml, or else the first one; note the other files."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = archive.infolist()
            if len(entries) > MAX_ENTRIES:
                raise FormatError("", f"{len(entries)} files in the archive: must be at most {MAX_ENTRIES}")
            found = [entry for entry in entries if entry.filename.lower().endswith(".kml")]
            if not found:
                raise FormatError("", "must be an archive that holds a .kml file")
            chosen = next((entry for entry in found if entry.filename.lower() == "doc.kml"), found[0])
            for entry in entries:
                if entry is not chosen and not entry.is_dir():
                    notes.note("other file of the archive", entry.filename[:60])
            with archive.open(chosen) as opened:
                text = opened.read(MAX_FILE_BYTES + 1)
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, ValueError, OSError) as error:
        raise FormatError("", f"must be a whole zip archive without a password ({error})") from None
    if len(text) > MAX_FILE_BYTES:
        raise FormatError(chosen.filename[:60], f"must be at most {MAX_FILE_BYTES} bytes when unpacked")
    return text


def _tree(data: bytes) -> Node:
    """Return the root element of an XML document."""
    parser = expat.ParserCreate()
    top = Node("", 0, {})
    stack, count = [top], 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > MAX_ELEMENTS or len(stack) > MAX_LEVELS:
            line = f"line {parser.CurrentLineNumber}"
            raise FormatError(line, f"must have at most {MAX_ELEMENTS} elements in {MAX_LEVELS} levels")
        node = Node(name.rpartition(":")[2].lower(), parser.CurrentLineNumber, attributes)
        stack[-1].children.append(node)
        stack.append(node)

    def end(_: str) -> None:
        stack.pop()

    def add_text(text: str) -> None:
        stack[-1].text.append(text)

    def refuse(*_: object) -> None:
        raise FormatError(f"line {parser.CurrentLineNumber}", "must have no document type declaration (DOCTYPE)")

    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    parser.CharacterDataHandler = add_text
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise FormatError(
            f"line {error.lineno}", f"must be whole, valid XML ({expat.ErrorString(error.code)})"
        ) from None
    except (ValueError, LookupError) as error:  # An unknown encoding.
        raise FormatError("line 1", f"must be XML in a known encoding ({error})") from None
    return top.children[0]


def _named(node: Node, name: str) -> Iterator[Node]:
    """Yield all elements of this name below a node."""
    for child in node.children:
        if child.name == name:
            yield child
        yield from _named(child, name)


def _features(node: Node, notes: Content) -> Iterator[Feature]:
    for child in [node] if node.name == "placemark" else node.children:
        if child.name == "placemark":
            yield _placemark(child, notes)
        elif child.name in CONTAINERS:
            yield from _features(child, notes)
        else:
            _note(child, notes)


def _note(node: Node, notes: Content) -> None:
    """Note an element that is not read."""
    if node.name in DRAWING:
        notes.note("styles, descriptions and views", f"line {node.line}")
    elif node.name not in PLAIN:
        notes.note(f"element {node.name[:40]}", f"line {node.line}")


def _placemark(node: Node, notes: Content) -> Feature:
    name = node.said("name")
    item = f"line {node.line}" + (f" ({name[:40]})" if name else "")
    data = node.child("extendeddata")
    stated = ((each.attributes.get("name", ""), each.said("value") or each.content) for each in _data(data))
    properties = properties_of(item, stated, notes)
    if name:
        if properties.get("name", name) != name:
            notes.note("property name beside the element name", item)
        properties["name"] = name
    if node.said("visibility") == "0":
        notes.note("hidden placemark: it is read like others", item)
    shapes = [shape for child in node.children for shape in _shapes(item, child, notes)]
    if not shapes:
        notes.note("placemark without a geometry", item)
    return Feature(item, properties, shapes)


def _data(node: Node | None) -> Iterator[Node]:
    for child in node.children if node is not None else ():
        if child.name in {"data", "simpledata"}:
            yield child
        else:
            yield from _data(child)


def _shapes(item: str, node: Node, notes: Content) -> Iterator[Shape]:
    if node.name in SIMPLE:
        positions = _positions(node)
        if node.name == "point":
            if len(positions) != 1:
                raise FormatError(f"line {node.line}", f"{len(positions)} positions of a point: must be 1")
            yield Shape(item, "point", [positions])
        else:
            yield Shape(item, "line", [positions])
        for child in node.children:
            _note(child, notes)
    elif node.name == "polygon":
        yield Shape(item, "polygon", _rings(node))
        for child in node.children:
            if child.name not in {"outerboundaryis", "innerboundaryis"}:
                _note(child, notes)
    elif node.name == "track":
        _note_track(item, node, notes)
        yield Shape(item, "line", [_track(node)])
    elif node.name in {"multigeometry", "multitrack"}:
        for index, child in enumerate(node.children, 1):
            yield from _shapes(f"{item}, part {index}", child, notes)
    else:
        _note(node, notes)


def _note_track(item: str, node: Node, notes: Content) -> None:
    """Note what a track holds besides its positions."""
    notes.note("times of a track: the route is flown at the mission's speed", item)
    for child in node.children:
        if child.name == "extendeddata":
            notes.note("data along a track", item)
        elif child.name not in {"coord", "when"}:
            _note(child, notes)


def _rings(node: Node) -> list[list[tuple[float, float, float]]]:
    """Return the rings of a polygon, the outer one first."""
    rings = []
    for side in ("outerboundaryis", "innerboundaryis"):
        for boundary in (child for child in node.children if child.name == side):
            rings += [_positions(ring) for ring in boundary.children if ring.name == "linearring"]
        if side == "outerboundaryis" and len(rings) != 1:
            raise FormatError(f"line {node.line}", f"{len(rings)} outer rings of a polygon: must be 1")
    return rings


def _positions(node: Node) -> list[tuple[float, float, float]]:
    """Return the positions in `coordinates`: longitude,latitude[,altitude], with white space between positions."""
    coordinates = node.child("coordinates")
    if coordinates is None:
        raise FormatError(f"line {node.line}", "must have coordinates")
    text = ",".join(part.strip() for part in coordinates.content.split(","))
    return [_position(f"line {coordinates.line}", part.split(",")) for part in text.split()]


def _track(node: Node) -> list[tuple[float, float, float]]:
    return [_position(f"line {child.line}", child.content.split()) for child in node.children if child.name == "coord"]


def _position(place: str, parts: list[str]) -> tuple[float, float, float]:
    if len(parts) not in {2, 3}:
        raise FormatError(place, f"{','.join(parts)[:60]!r}: must be longitude,latitude or longitude,latitude,altitude")
    lon_deg, lat_deg = parsed(place, "longitude", parts[0]), parsed(place, "latitude", parts[1])
    check_lat_lon(place, lat_deg, lon_deg)
    return lat_deg, lon_deg, parsed(place, "altitude", parts[2]) if len(parts) == 3 and parts[2] else 0.0
