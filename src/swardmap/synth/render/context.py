"""The OpenGL context, without a window, and its shader programs."""

from importlib import resources
from typing import Any

from swardmap.errors import MissingExtraError, require
from swardmap.labels import GRASS, OTHER

APT = "apt-get install libegl1 libgl1-mesa-dri libgles2"
NEEDED = 330

Context = Any
Program = Any


def open_context() -> Context:
    """A context of its own through EGL: of the GPU, or of Mesa's software driver.

    Raises:
        MissingExtraError: if moderngl or the driver is not installed, with the commands to install them.
    """
    moderngl = require("moderngl", "synth", f"It needs an OpenGL driver too: {APT}")
    try:
        context = moderngl.create_context(require=NEEDED, standalone=True, backend="egl")
    except Exception as error:
        raise MissingExtraError(
            f"OpenGL 3.3 cannot be opened through EGL ({error}). Install a driver with: {APT} "
            "(Mesa's software driver; a GPU needs the EGL library of its own driver)"
        ) from error
    context.gc_mode = "context_gc"
    return context


def driver_of(context: Context) -> str:
    """Renderer and version, such as `llvmpipe (LLVM 15.0.6, 256 bits), 4.5 (Core Profile) Mesa 22.3.6`."""
    return f"{context.info['GL_RENDERER']}, {context.info['GL_VERSION']}"


def source_of(file: str) -> str:
    """Text of a shader with what it includes, each file once."""
    return "\n".join(_lines_of(file, set()))


def _lines_of(file: str, seen: set[str]) -> list[str]:
    text = (resources.files("swardmap.synth.render") / "shaders" / file).read_text(encoding="utf-8")
    lines: list[str] = []
    for line in text.splitlines():
        if line.startswith("#include"):
            name = line.split('"')[1]
            if name not in seen:
                seen.add(name)
                lines += _lines_of(name, seen)
        else:
            lines.append(line)
    return lines


def program_of(context: Context, vertex: str, fragment: str, *defines: str) -> Program:
    """Compile a program.

    Args:
        context: for which.
        vertex: name of the shader, such as thing.
        fragment: of the other.
        defines: which outputs: RADIANCE, TRUTH or both.
    """
    head = ["#version 330", *(f"#define {name}" for name in defines)]
    head += [f"#define GRASS {GRASS.id}u", f"#define OTHER {OTHER.id}u", ""]
    program = context.program(
        vertex_shader="\n".join(head) + source_of(f"{vertex}.vert.glsl"),
        fragment_shader="\n".join(head) + source_of(f"{fragment}.frag.glsl"),
    )
    if "Frame" in program:
        program["Frame"].binding = 0
    return program


def set_uniforms(program: Program, **values: Any) -> None:
    """Set uniforms; those that the compiler has left out are passed over.

    Args:
        program: whose.
        values: numbers, tuples, or bytes as they are.
    """
    for name, value in values.items():
        uniform = program.get(name, None)
        if uniform is None:
            continue
        if isinstance(value, bytes):
            uniform.write(value)
        else:
            uniform.value = value


def layout_of(program: Program, buffer: Any, *fields: str, each: str = "") -> tuple[Any, ...]:
    """Layout of a buffer for a program; what the compiler has left out is skipped.

    Args:
        program: for which.
        buffer: of the vertices or instances.
        fields: `name:format`, such as `xyz:3f`; one after the other.
        each: `/i` for one an instance.
    """
    formats, names = [], []
    for name, form in (part.split(":") for part in fields):
        if name in program:
            formats.append(form)
            names.append(name)
        else:
            size = int(form[2:] or 4) if len(form) > 2 else 4
            formats.append(f"{int(form[0]) * size}x")
    return (buffer, " ".join(formats) + each, *names)
