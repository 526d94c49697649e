"""Renders what `cycles_scene.py` wrote, with Cycles on the CPU. Runs in the Python that has bpy; prints a line of JSON.

    python cycles_render.py FOLDER SPP REPEAT

A call of Blender's render also hands the scene to Cycles and builds its tree, so seconds are those of a render of
SPP + 1 samples less those of one of 1 sample. The pictures go to FOLDER/pictures.npy.
"""

import json
import math
import resource
import sys
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix


def node_material(values: dict[str, Any]) -> Any:
    """A material of one shader."""
    made = bpy.data.materials.new(values["type"])
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    kinds = {"diffuse": "BsdfDiffuse", "metal": "BsdfAnisotropic", "glass": "BsdfGlass", "emissive": "Emission"}
    shader = tree.nodes.new("ShaderNode" + kinds[values["type"]])
    if "color" in values:
        shader.inputs["Color"].default_value = (*values["color"], 1)
    if values["type"] == "metal":  # Cycles squares the roughness
        shader.distribution = "GGX"
        shader.inputs["Roughness"].default_value = math.sqrt(values["alpha"])
    elif values["type"] == "glass":
        shader.inputs["Color"].default_value = (1, 1, 1, 1)
        shader.inputs["Roughness"].default_value = 0
        shader.inputs["IOR"].default_value = values["ior"]
    elif values["type"] == "emissive":
        front = tree.nodes.new("ShaderNodeMath")
        front.operation = "SUBTRACT"
        front.inputs[0].default_value = 1
        side = tree.nodes.new("ShaderNodeNewGeometry")
        tree.links.new(side.outputs["Backfacing"], front.inputs[1])
        tree.links.new(front.outputs[0], shader.inputs["Strength"])
        made.cycles.emission_sampling = "FRONT"
    out = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], out.inputs["Surface"])
    return made


def mesh_of(folder: Path, number: int, smooth: bool) -> Any:
    """A mesh of triangles from its arrays."""
    points = np.load(folder / f"{number}-positions.npy")
    corners = np.load(folder / f"{number}-indices.npy")
    made = bpy.data.meshes.new(f"mesh{number}")
    made.vertices.add(len(points))
    made.vertices.foreach_set("co", points.ravel())
    made.loops.add(corners.size)
    made.loops.foreach_set("vertex_index", corners.ravel())
    made.polygons.add(len(corners))
    made.polygons.foreach_set("loop_start", np.arange(0, corners.size, 3, dtype=np.int32))
    made.update(calc_edges=True)
    made.polygons.foreach_set("use_smooth", np.full(len(corners), smooth))
    return made


def of_the_object(material: Any) -> Any:
    """Lets a material take its colour and roughness from the object, so that objects of many colours can share it."""
    tree = material.node_tree
    (shader,) = (node for node in tree.nodes if "Color" in node.inputs and node.outputs)
    colors = tree.nodes.new("ShaderNodeObjectInfo")
    tree.links.new(colors.outputs["Color"], shader.inputs["Color"])
    if "Roughness" in shader.inputs:
        rough = tree.nodes.new("ShaderNodeAttribute")
        rough.attribute_type, rough.attribute_name = "OBJECT", "rough"
        tree.links.new(rough.outputs["Fac"], shader.inputs["Roughness"])
    return material


def add_objects(scene: Any, folder: Path, found: dict[str, Any]) -> None:
    """Cycles shares the tree of objects of one mesh and one material: so materials of one kind become one."""
    materials = found["materials"]
    uses: dict[int, set[int]] = {}
    for entry in found["objects"]:
        uses.setdefault(entry["mesh"], set()).add(entry["material"])
    data: dict[tuple[int, str], Any] = {}
    for entry, place in zip(found["objects"], np.load(folder / "places.npy"), strict=True):
        values, many = materials[entry["material"]], len(uses[entry["mesh"]]) > 1
        key = entry["mesh"], values["type"] if many and values["type"] in ("diffuse", "metal") else json.dumps(values)
        if key not in data:
            data[key] = mesh_of(folder, entry["mesh"], found["meshes"][entry["mesh"]]["smooth"])
            made_of = node_material(values)
            data[key].materials.append(of_the_object(made_of) if key[1] == values["type"] else made_of)
        made = bpy.data.objects.new("object", data[key])
        made.matrix_world = Matrix(place.tolist())
        if "color" in values:
            made.color = (*values["color"], 1)
        made["rough"] = math.sqrt(values.get("alpha", 0.0))
        scene.collection.objects.link(made)


def add_camera(scene: Any, values: dict[str, Any]) -> None:
    """A thin lens; Blender asks for its f-number."""
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit = "VERTICAL"
    lens.angle = math.radians(values["vfov"])
    lens.clip_start, lens.clip_end = 0.01, 1e6
    if values["aperture_radius"] > 0:
        lens.dof.use_dof = True
        lens.dof.focus_distance = values["focus_distance"]
        lens.dof.aperture_fstop = 1e-3 * lens.lens / (2 * values["aperture_radius"])
    made = bpy.data.objects.new("camera", lens)
    made.matrix_world = Matrix(values["matrix"])
    scene.collection.objects.link(made)
    scene.camera = made


def add_sky(scene: Any, values: dict[str, Any]) -> None:
    """From `bottom` straight down to `top` straight up, by the height of the direction (y is up)."""
    world = bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    background, out = tree.nodes.new("ShaderNodeBackground"), tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(background.outputs[0], out.inputs[0])
    if values["bottom"] == values["top"]:
        background.inputs["Color"].default_value = (*values["top"], 1)
        return
    where, parts = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeSeparateXYZ")
    height, mix = tree.nodes.new("ShaderNodeMapRange"), tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    height.inputs["From Min"].default_value, height.inputs["From Max"].default_value = -1, 1
    tree.links.new(where.outputs["Generated"], parts.inputs[0])
    tree.links.new(parts.outputs["Y"], height.inputs["Value"])
    tree.links.new(height.outputs[0], mix.inputs[0])
    colors = [socket for socket in mix.inputs if socket.type == "RGBA"]
    colors[0].default_value, colors[1].default_value = (*values["bottom"], 1), (*values["top"], 1)
    tree.links.new(next(s for s in mix.outputs if s.type == "RGBA"), background.inputs["Color"])


def add_suns(scene: Any, suns: list[dict[str, Any]]) -> None:
    """Parallel lights. Blender's strength is the irradiance."""
    for values in suns:
        light = bpy.data.lights.new("sun", "SUN")
        light.angle, light.energy, light.color = 0, 1, values["irradiance"]
        made = bpy.data.objects.new("sun", light)
        z = -np.array(values["direction"]) / np.linalg.norm(values["direction"])
        x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
        x /= np.linalg.norm(x)
        place = np.eye(4)
        place[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        made.matrix_world = Matrix(place.tolist())
        scene.collection.objects.link(made)


def set_up(scene: Any, size: list[int], max_depth: int) -> None:
    """Everything that makes the work the same: depth, no clamping, no filters of noise, no adaptive sampling."""
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
    bounces = max_depth - 2  # the camera's segment and the last one to a light do not count
    cycles.device = "CPU"
    for kind in ("max", "diffuse", "glossy", "transmission"):
        setattr(cycles, f"{kind}_bounces", bounces)
    cycles.min_light_bounces = cycles.min_transparent_bounces = 1024  # no Russian roulette
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.blur_glossy = 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.use_adaptive_sampling = cycles.use_denoising = cycles.use_auto_tile = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.light_sampling_threshold = 0


class Renders:
    """Renders with new seeds."""

    def __init__(self, scene: Any, folder: Path) -> None:
        self.scene, self.file, self.seed = scene, folder / "picture.exr", 0
        settings = scene.render.image_settings
        settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGB"

    def once(self, spp: int) -> tuple[float, float]:
        """Seconds, and processor seconds."""
        self.scene.cycles.samples, self.scene.cycles.seed = spp, self.seed
        self.seed += 1
        wall, core = time.perf_counter(), time.process_time()
        bpy.ops.render.render(write_still=False)
        return time.perf_counter() - wall, time.process_time() - core

    def picture(self) -> Any:
        """The last one, linear, row 0 at the top."""
        bpy.data.images["Render Result"].save_render(str(self.file), scene=self.scene)
        found = bpy.data.images.load(str(self.file))
        found.colorspace_settings.name = "Non-Color"
        width, height = found.size
        texels = np.empty(width * height * 4, np.float32)
        found.pixels.foreach_get(texels)
        bpy.data.images.remove(found)
        return texels.reshape(height, width, 4)[::-1, :, :3].copy()


def main() -> None:
    """Builds, renders, prints the figures."""
    folder, spp, repeat = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    began = time.perf_counter()
    found = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Raw"
    add_objects(scene, folder, found)
    add_camera(scene, found["camera"])
    add_sky(scene, found["sky"])
    add_suns(scene, found["suns"])
    set_up(scene, found["size"], found["max_depth"])
    load = time.perf_counter() - began
    renders = Renders(scene, folder)
    first, _ = renders.once(1)
    one = [min(pair) for pair in zip(renders.once(1), renders.once(1), strict=True)]
    runs, pictures = [], []
    for _ in range(max(2, repeat)):
        runs.append(renders.once(spp + 1))
        pictures.append(renders.picture())
    np.save(folder / "pictures.npy", np.array(pictures))
    figures = {
        "load_seconds": load,
        "first_seconds": first,
        "walls": [wall - one[0] for wall, _ in runs],
        "cores": [core - one[1] for _, core in runs],
        "peer_version": "cycles " + bpy.app.version_string,
        "peak_host_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
    }
    print("\n" + json.dumps(figures))


if __name__ == "__main__":
    main()
