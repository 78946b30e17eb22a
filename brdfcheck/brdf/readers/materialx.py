"""MaterialX documents and surfaces: the package MaterialX generates GLSL, and the shader reader evaluates that.

Three things of a generated pixel shader are not those of a BRDF. Its light: one of intensity 1 from the direction asked for
takes the place of the scene's. What it adds to the reflection of that light: environment, emission and what is seen through
the surface are closures of other types, and asked for none of them, all nodes answer 0. The cosine at the light: it is divided
out.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from brdfcheck.brdf.family import Family, interval
from brdfcheck.brdf.readers.base import AbstractFile, Reading
from brdfcheck.brdf.readers.glsl.errors import did_you_mean
from brdfcheck.brdf.readers.glsl.kinds import BOOL, FLOAT, INT, Type, Vector
from brdfcheck.brdf.readers.glsl.knobs import Knob, names_of
from brdfcheck.brdf.readers.glsl.preprocessor import read_text
from brdfcheck.brdf.readers.glsl.shader import Made, ShaderFile
from brdfcheck.brdf.readers.specs import PREFIXES, split_spec
from brdfcheck.messages import UsageError, one_line

# Compiled modules, of which no type checker knows what is in them.
mx: Any = import_module("MaterialX")
glsl: Any = import_module("MaterialX.PyMaterialXGenGlsl")
shadergen: Any = import_module("MaterialX.PyMaterialXGenShader")

_SURFACE = "surfaceshader"
_TYPES: dict[str, Type] = {
    "float": FLOAT,
    "integer": INT,
    "boolean": BOOL,
    "vector2": Vector("float", 2),
    "vector3": Vector("float", 3),
    "vector4": Vector("float", 4),
    "color3": Vector("float", 3),
    "color4": Vector("float", 4),
}
_LINEAR = "lin_rec709"
_OPEN = (-math.inf, math.inf)
_WORDS = {"true": "1", "false": "0"}
_FRAME = {"normalWorld": "vec3(0.0, 0.0, 1.0)", "tangentWorld": "vec3(1.0, 0.0, 0.0)", "bitangentWorld": "vec3(0.0, 1.0, 0.0)"}
# The function that is read, which stands at the end of the generated text, and the light it asks for.
_NAME, _LIGHT = "materialx_brdf", "materialx_light"
_LIGHTS = f"""vec3 {_LIGHT};
int numActiveLightSources() {{ return 1; }}
void sampleLightSource(LightData light, vec3 position, out lightshader result)
{{
    result.intensity = vec3(1.0);
    result.direction = {_LIGHT};
}}
"""


@dataclass(frozen=True)
class _Parameter(Knob):
    """A number, vector or colour that the generated shader takes; its node has `default` where nothing is said.

    `limits`: the uimin and uimax of its node.
    """

    limits: tuple[float, float] = _OPEN


class MaterialXFile(AbstractFile):
    """A surface of a ``.mtlx`` document, as ``FILE[:NODE]``, or one that MaterialX defines, as ``materialx:NODE``.

    All inputs are held until a range is given, at what the document gives or what the node's definition does; colours that the
    document does not give are white, but for radii, and for those whose default is black: they switch something off. Raises
    UsageError.
    """

    def __init__(self, spec: str):
        if spec.startswith(PREFIXES):
            self._document, node = _alone(spec)
            self.spec, self.path, self.files = spec, spec, ()
        else:
            path, asked = split_spec(spec)
            self.path, self.files = path, (path,)
            self._document = _read(path)
            node = _chosen(self._document, asked, path)
            self.spec = f"{path}:{node.getName()}"
        self._node = node.getNamePath()
        self._inputs = self._defined(node)
        self._checked()
        self._linked: dict[str, Type] = {}
        for item in node.getInputs():
            kind = _TYPES.get(item.getType())
            if kind is not None and not item.getValueString():
                self._linked[item.getName()] = kind
        self._text, self._parameters, self._images = self._generated(())
        types = {**{item.name: item.type for item in self._parameters}, **self._linked}
        # The inputs of the surface, those of the nodes before it, and their components.
        self.names = tuple(names_of(Knob(name, kind) for name, kind in types.items()))
        self.whole = frozenset(name for name, kind in types.items() if kind == INT)

    def family(
        self, ranges: Mapping[str, Any], cos_theta: tuple[float, float] | None, no_parameter: Callable[..., str]
    ) -> Family:
        """The family over these ranges; an input that is given is no longer linked to another node. UsageError."""
        given = {name.partition(".")[0] for name in ranges}
        freed = tuple(name for name in self._linked if name in given)
        text, parameters, images = self._generated(freed) if freed else (self._text, self._parameters, self._images)
        if images:
            linked = ", ".join(name for name in self._linked if name not in freed)
            raise UsageError(
                f"{self.spec}: the image {images[0]!r} has no value for one pair of directions; give what it is linked to a"
                f" value, as in --over NAME=VALUE or NAME=R,G,B; linked inputs: {linked}"
            )
        for item in parameters:
            for name in ranges:
                if name.partition(".")[0] == item.name:
                    _within(self.spec, name, ranges[name], item)
        file = ShaderFile(f"{self.spec} as GLSL", _NAME, Reading(), Made(text, tuple(parameters), self.spec))
        family = file.family(ranges, cos_theta, no_parameter)
        # Forty inputs that are what they always are would hide the few that are not.
        usual = {item.name for item in parameters if item.plain == item.default} - given
        return dataclasses.replace(
            family, held={key: n for key, n in family.held.items() if key.partition(".")[0] not in usual}
        )

    def _defined(self, node: Any) -> dict[str, Any]:
        """The inputs of a surface, as MaterialX defines them. UsageError where it has others, or values of other types."""
        kind, definition = node.getCategory(), node.getNodeDef()
        forms = [item for item in _library().getMatchingNodeDefs(kind) if item.getType() == _SURFACE]
        if definition is None and not forms:
            near = did_you_mean(kind, _surfaces())
            raise UsageError(f"{self.spec}: MaterialX defines no surface {one_line(kind)!r}{near}")
        inputs = {item.getName(): item for item in (definition or forms[0]).getActiveInputs()}
        for item in node.getInputs():
            name, type_name = item.getName(), item.getType()
            if name not in inputs:
                near = did_you_mean(name, inputs)
                raise UsageError(f"{self.spec}: {one_line(kind)} has no input {one_line(name)!r}{near}")
            if type_name != inputs[name].getType():
                wanted = f"{name!r} of {one_line(kind)} is a {inputs[name].getType()}"
                raise UsageError(f"{self.spec}: the input {wanted}; got {one_line(type_name)!r}")
        if definition is None:
            raise UsageError(f"{self.spec}: MaterialX defines no {one_line(kind)} of this version")
        return inputs

    def _checked(self) -> None:
        """UsageError for values that are none, and for links that lead nowhere: MaterialX takes them all the same."""
        for item in self._document.traverseTree():
            if item.getCategory() != "input":
                continue
            name, kind, text = item.getNamePath(), item.getType(), item.getValueString()
            if text and kind in _TYPES:
                self._numbers(name, text, kind)
            space = item.getActiveColorSpace() if kind in ("color3", "color4") else ""
            if space not in ("", _LINEAR) and _library().getNodeDef(f"ND_{space}_to_{_LINEAR}_{kind}") is None:
                shown = f"{one_line(space)!r} of {one_line(name)!r}"
                raise UsageError(f"{self.spec}: MaterialX does not know the colour space {shown}")
            if item.getNodeName() and item.getConnectedNode() is None:
                linked = one_line(item.getNodeName())
                raise UsageError(f"{self.spec}: the input {one_line(name)!r} is linked to {linked!r}, which is not there")

    def _generated(self, freed: Iterable[str]) -> tuple[str, list[_Parameter], list[str]]:
        """The shader, its parameters, and the nodes that are images; without the links of `freed`. UsageError."""
        document = self._document.copy()
        node = document.getDescendant(self._node)
        for name in freed:
            node.removeInput(name)
        try:
            generator, context = _generated_by(_library())
            # The stage does not keep the shader alive that it is a part of.
            shader = generator.generate("surface", node, context)
        except Exception as error:  # whatever the package refuses, it is the document's
            raise UsageError(f"{self.spec}: MaterialX cannot make a shader of it: {one_line(error)}") from None
        stage = shader.getStage("pixel")
        blocks = stage.getUniformBlocks()
        ports = [blocks["PublicUniforms"][i] for i in range(blocks["PublicUniforms"].size())]
        hidden = [blocks["PrivateUniforms"][i].getVariable() for i in range(blocks["PrivateUniforms"].size())]
        vertex = stage.getInputBlocks()["VertexData"]
        fields = [(vertex[i].getVariable(), vertex[i].getType().getName()) for i in range(vertex.size())]
        images = [one_line(port.getPath().rpartition("/")[0]) for port in ports if port.getType().getName() == "filename"]
        parameters = [self._parameter(port, node) for port in ports if port.getType().getName() in _TYPES]
        return _as_brdf(stage.getSourceCode(), self.spec, hidden, fields), parameters, images

    def _parameter(self, port: Any, node: Any) -> _Parameter:
        kind, name = port.getType().getName(), port.getName()
        value = self._numbers(port.getVariable(), port.getValue().getValueString() if port.getValue() else "", kind)
        source = self._inputs.get(name)
        owner = port.getPath().rpartition("/")[0]
        if source is None or owner not in (node.getNamePath(), node.getNodeDef().getName()):
            return _Parameter(port.getVariable(), _TYPES[kind], default=value, plain=value)
        usual = self._numbers(name, source.getValueString(), kind)
        own = node.getInput(name)
        if own is None and kind in ("color3", "color4") and any(usual) and "radius" not in name:
            value = (1.0,) * len(usual)
        ends = (source.getAttribute("uimin"), source.getAttribute("uimax"))
        low, high = (self._numbers(name, end, kind)[0] if end else side for end, side in zip(ends, _OPEN, strict=True))
        return _Parameter(port.getVariable(), _TYPES[kind], default=usual, plain=value, limits=(low, high))

    def _numbers(self, name: str, text: str, kind: str) -> tuple[float, ...]:
        """A value of MaterialX as numbers, zeros where it has none."""
        size = _TYPES[kind].leaves
        try:
            found = tuple(float(_WORDS.get(word.strip(), word)) for word in text.split(",")) if text else (0.0,) * size
        except ValueError:
            found = ()
        if len(found) != size or not all(map(math.isfinite, found)):
            raise UsageError(f"{self.spec}: {one_line(name)!r} is a {kind} of finite numbers; got {one_line(text)!r}")
        return found


def _within(spec: str, name: str, bounds: Any, item: _Parameter) -> None:
    """UsageError where a value is beyond what the definition of the node allows."""
    low, high = item.limits
    try:
        wrong = not all(low <= float(bound) <= high for bound in bounds)
    except (TypeError, ValueError):
        interval(name, bounds)
        raise
    if wrong:
        shown = ":".join(f"{float(bound):g}" for bound in bounds)
        allowed = f"from {low:g}" if math.isinf(high) else f"within {low:g}:{high:g}"
        raise UsageError(f"{spec}: {name} runs {allowed}, as MaterialX defines it; got {shown}")


def _as_brdf(text: str, spec: str, hidden: Iterable[str], fields: Iterable[tuple[str, str]]) -> str:
    """A generated pixel shader, with a function of L and V that is its BRDF. UsageError.

    The cosine that is divided out is the shader's own, which is nowhere below M_FLOAT_EPS.
    `hidden`: uniforms that the function sets, so that they are no parameters; `fields`: what a vertex has, with its types.
    """
    if "makeClosureData(CLOSURE_TYPE_REFLECTION," not in text:
        raise UsageError(f"{spec}: it reflects no light: there is no BSDF in it")
    # Without an environment the generator uses this uniform and does not declare it.
    twosided = "" if "bool u_refractionTwoSided" in text else "const bool u_refractionTwoSided = false;\n"
    changes = [
        (rf"^uniform (?=[\w ]+ (?:{'|'.join((*hidden, 'u_lightData'))})\b)", ""),
        (r"^in (?=VertexData$)", f"{twosided}struct "),
        (r"^out (?=vec4 \w+;$)", ""),
        (r"(?<=makeClosureData\()CLOSURE_TYPE_(?:INDIRECT|EMISSION|TRANSMISSION)(?=,)", "CLOSURE_TYPE_DEFAULT"),
        # So that the compiler leaves out what a mix turns off: a subsurface layer is a loop.
        (
            r"result\.response = in1\.response \* weight;",
            "result.response = vec3(0.0); if (weight > 0.0) result.response = in1.response * weight;",
        ),
        # Of a plane, which has no curvature.
        (r"length\(fwidth\(N\)\) / length\(fwidth\(P\)\)", "0.0"),
        (r"^int numActiveLightSources(?=\(\)$)", "int unusedCount"),
        (r"^void sampleLightSource(?=\(LightData light,.*\)$)", "void unusedLight"),
        (r"^LightData u_lightData\[.*\];$", rf"\g<0>\n{_LIGHTS}"),
    ]
    for pattern, new in changes:
        text = re.sub(pattern, new, text, flags=re.MULTILINE)
    vertex = "".join(
        f"    vd.{name} = {_FRAME.get(name, {'vector2': 'vec2(0.0)', 'vector4': 'vec4(0.0)'}.get(kind, 'vec3(0.0)'))};\n"
        for name, kind in fields
    )
    result = re.findall(r"^vec4 (\w+);$", text, flags=re.MULTILINE)
    return f"""{text}
vec3 {_NAME}(vec3 L, vec3 V)
{{
    {_LIGHT} = L;
    u_viewPosition = V;
{vertex}    main();
    return {result[0]}.rgb / max(L.z, M_FLOAT_EPS);
}}
"""


@cache
def _library() -> Any:
    """All that MaterialX defines."""
    library = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    return library


def _surfaces() -> list[str]:
    """The names of the surfaces that MaterialX defines."""
    nodes = (item for item in _library().getNodeDefs() if item.getType() == _SURFACE and item.getNodeGroup() == "pbr")
    return sorted({item.getNodeString() for item in nodes})


def _generated_by(library: Any) -> tuple[Any, Any]:
    """A generator of GLSL, and its context: no environment, every input a uniform, colours and lengths converted."""
    generator = glsl.GlslShaderGenerator.create()
    colours = shadergen.DefaultColorManagementSystem.create(generator.getTarget())
    colours.loadLibrary(library)
    generator.setColorManagementSystem(colours)
    units, registry = shadergen.UnitSystem.create(generator.getTarget()), mx.UnitConverterRegistry.create()
    units.loadLibrary(library)
    for kind in library.getUnitTypeDefs():
        registry.addUnitConverter(kind, mx.LinearUnitConverter.create(kind))
    units.setUnitConverterRegistry(registry)
    generator.setUnitSystem(units)
    context = shadergen.GenContext(generator)
    context.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
    options = context.getOptions()
    options.hwSpecularEnvironmentMethod = shadergen.HwSpecularEnvironmentMethod.SPECULAR_ENVIRONMENT_NONE
    options.shaderInterfaceType = shadergen.ShaderInterfaceType.SHADER_INTERFACE_COMPLETE
    options.targetColorSpaceOverride, options.targetDistanceUnit = _LINEAR, "meter"
    return generator, context


def _alone(spec: str) -> tuple[Any, Any]:
    """A document that holds one surface of MaterialX, and it."""
    name = spec.partition(":")[2]
    known = _surfaces()
    if name not in known:
        raise UsageError(
            f"MaterialX defines no surface {one_line(name)!r}{did_you_mean(name, known)}; it has {', '.join(known)}"
        )
    forms = [item for item in _library().getMatchingNodeDefs(name) if item.getType() == _SURFACE]
    form = next((item for item in forms if item.getDefaultVersion()), forms[0])
    document = mx.createDocument()
    document.setDataLibrary(_library())
    return document, document.addNodeInstance(form, "brdfcheck_surface")


def _read(path: str) -> Any:
    """A document of a file. UsageError."""
    text = read_text(path)
    document = mx.createDocument()
    try:
        mx.readFromXmlString(document, text, mx.FileSearchPath(str(Path(path).parent)))
        document.setDataLibrary(_library())
    except Exception as error:  # whatever the package refuses, it is the file's
        raise UsageError(f"{one_line(path)}: this is no MaterialX document: {one_line(error)}") from None
    return document


def _chosen(document: Any, asked: str | None, path: str) -> Any:
    """The surface that is meant: it, or a material or node graph with one; the only one where none is asked for. UsageError.

    A graph that implements a node has no surface of its own.
    """
    own = (item for item in document.getChildren() if isinstance(item, mx.NodeGraph))  # the library has more
    graphs = [graph for graph in own if not graph.getNodeDefString()]
    inner = [node for graph in graphs for node in graph.getNodes()]
    found = {node.getName(): node for node in (*inner, *document.getNodes()) if node.getType() == _SURFACE}
    materials = {node.getName(): mx.getShaderNodes(node, _SURFACE) for node in document.getMaterialNodes()}
    outputs = {
        graph.getName(): [item.getConnectedNode() for item in graph.getOutputs() if item.getType() == _SURFACE]
        for graph in graphs
    }
    known = {**{name: nodes[0] for name, nodes in (materials | outputs).items() if any(nodes)}, **found}
    offers, shown = one_line(", ".join(sorted(known)) or "none"), one_line(path)
    if asked is not None:
        if asked not in known:
            near = did_you_mean(asked, known)
            raise UsageError(f"{shown} has no surface or material {one_line(asked)!r}{near}; it has {offers}")
        return known[asked]
    if not found:
        raise UsageError(f"{shown} has no surface")
    if len(found) > 1:
        raise UsageError(f"{shown} has {len(found)} surfaces: name one, as in {shown}:{next(iter(found))}; it has {offers}")
    return next(iter(found.values()))
