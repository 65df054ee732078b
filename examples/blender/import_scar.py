"""Show .scar files in Blender, as an add-on or a script (README.md)."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.io_utils import ImportHelper
from mathutils import Quaternion, Vector

bl_info = {"name": "Gaussians (.scar)", "blender": (3, 4, 0), "category": "Import-Export"}
SPLAT = "KHR_gaussian_splatting"
SIGMAS = 2.0  # radius of an ellipsoid, standard deviations
UPRIGHT = Quaternion((0, 1, 1), np.pi)  # from glTF, where y is up, so that the source's x axis stays


def read_scar(path):
    """The node and the primitive of the file as glTF, and its arrays by name, (N, width) float32; not COLOR_0."""
    command = shutil.which("scarfmt")
    if command is None:
        raise RuntimeError("scarfmt is not found: install it, and start Blender from a terminal where it runs")
    done = subprocess.run([command, "decode", "--quiet", "--format", "glb", path, "-"], capture_output=True)
    if done.returncode:
        raise RuntimeError(done.stderr.decode().strip())
    start = 20 + int.from_bytes(done.stdout[12:16], "little")
    document = json.loads(done.stdout[20:start])
    primitive, arrays = document["meshes"][0]["primitives"][0], {}
    for name, number in primitive["attributes"].items():
        view = document["bufferViews"][number]
        values = np.frombuffer(done.stdout, "<f4", view["byteLength"] // 4, start + 8 + view["byteOffset"])
        arrays[name.removeprefix(f"{SPLAT}:")] = values.reshape(document["accessors"][number]["count"], -1)
    return document["nodes"][0], primitive, arrays


def add_node(tree, kind, *inputs, **settings):
    """A node's first output in use. Its inputs are values or sockets, or None."""
    node = tree.nodes.new(kind)
    for name, value in settings.items():
        setattr(node, name, value)
    for socket, value in zip(node.inputs, inputs, strict=False):
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        elif value is not None:
            socket.default_value = value
    return next((socket for socket in node.outputs if socket.enabled), None)


def make_material():
    """Light of a Gaussian's colour; opacity falls as exp(-d^2 / 2), d being how far a ray passes from the middle."""
    material = bpy.data.materials.new("Gaussians")
    material.use_nodes, material.blend_method = True, "HASHED"
    tree, vector, scalar = material.node_tree, "ShaderNodeVectorMath", "ShaderNodeMath"
    tree.nodes.clear()
    surface = tree.nodes.new("ShaderNodeNewGeometry").outputs
    place = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    own = {"attribute_type": "INSTANCER"}
    colour = add_node(tree, "ShaderNodeAttribute", attribute_name="color", **own)
    opacity = add_node(tree, "ShaderNodeAttribute", attribute_name="opacity", **own)
    ray = add_node(tree, "ShaderNodeVectorTransform", surface["Incoming"], convert_from="WORLD", convert_to="OBJECT")
    ray = add_node(tree, vector, ray, operation="NORMALIZE")
    offset = add_node(tree, vector, place, ray, operation="CROSS_PRODUCT")
    square = add_node(tree, vector, offset, offset, operation="DOT_PRODUCT")
    alpha = add_node(tree, scalar, np.exp(-0.5), square, operation="POWER")
    alpha = add_node(tree, scalar, alpha, opacity, operation="MULTIPLY")
    alpha = add_node(tree, scalar, alpha, surface["Backfacing"], operation="SUBTRACT", use_clamp=True)  # once a ray
    clear, light = add_node(tree, "ShaderNodeBsdfTransparent"), add_node(tree, "ShaderNodeEmission", colour)
    add_node(tree, "ShaderNodeOutputMaterial", add_node(tree, "ShaderNodeMixShader", alpha, clear, light))
    return material


def add_ellipsoids(thing):
    """Let geometry nodes put an ellipsoid on each vertex of an object."""
    bpy.context.view_layer.objects.active = thing
    bpy.ops.node.new_geometry_nodes_modifier()
    tree = thing.modifiers[0].node_group
    tree.nodes.clear()
    ball = add_node(tree, "GeometryNodeMeshIcoSphere", SIGMAS, 2)
    ball = add_node(tree, "GeometryNodeSetMaterial", ball, None, make_material())
    turn = add_node(tree, "GeometryNodeInputNamedAttribute", "rotation", data_type="FLOAT_VECTOR")
    scale = add_node(tree, "GeometryNodeInputNamedAttribute", "scale", data_type="FLOAT_VECTOR")
    points = add_node(tree, "NodeGroupInput")
    balls = add_node(tree, "GeometryNodeInstanceOnPoints", points, None, ball, None, None, turn, scale)
    add_node(tree, "NodeGroupOutput", balls)


def import_scar(path):
    """Add an object, upright: a vertex for each Gaussian."""
    node, primitive, arrays = read_scar(path)
    colour = np.maximum(0.5 + 0.28209479 * arrays["SH_DEGREE_0_COEF_0"], 0)
    if primitive["extensions"][SPLAT]["colorSpace"].startswith("srgb"):
        colour = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    turns = np.array([Quaternion((w, x, y, z)).to_euler() for x, y, z, w in arrays["ROTATION"].tolist()])
    mesh = bpy.data.meshes.new(Path(path).stem)
    mesh.vertices.add(len(turns))
    mesh.vertices.foreach_set("co", arrays["POSITION"].ravel())
    for name, kind, field, values in (
        ("color", "FLOAT_COLOR", "color", np.pad(colour, ((0, 0), (0, 1)), constant_values=1)),
        ("opacity", "FLOAT", "value", arrays["OPACITY"]),
        ("scale", "FLOAT_VECTOR", "vector", arrays["SCALE"]),
        ("rotation", "FLOAT_VECTOR", "vector", turns),
    ):
        mesh.attributes.new(name, kind, "POINT").data.foreach_set(field, values.astype(np.float32).ravel())
    mesh.update()
    thing = bpy.data.objects.new(mesh.name, mesh)
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    thing.rotation_mode, thing.rotation_quaternion = "QUATERNION", UPRIGHT @ Quaternion((w, x, y, z))
    thing.location = UPRIGHT @ Vector(node.get("translation", (0, 0, 0)))
    bpy.context.collection.objects.link(thing)
    add_ellipsoids(thing)


class ImportScar(bpy.types.Operator, ImportHelper):
    """Import a .scar file"""

    bl_idname, bl_label, bl_options = "import_scene.scar", "Gaussians (.scar)", {"UNDO"}
    filter_glob: bpy.props.StringProperty(default="*.scar", options={"HIDDEN"})

    def execute(self, context):
        try:
            import_scar(self.filepath)
        except RuntimeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


def add_to_menu(menu, context):
    menu.layout.operator(ImportScar.bl_idname)


def register():
    bpy.utils.register_class(ImportScar)
    bpy.types.TOPBAR_MT_file_import.append(add_to_menu)


def unregister():
    bpy.types.TOPBAR_MT_file_import.remove(add_to_menu)
    bpy.utils.unregister_class(ImportScar)


if __name__ == "__main__":
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.transparent_max_bounces = "CYCLES", 1024
    scene.view_settings.view_transform = "Standard"
    import_scar(sys.argv[sys.argv.index("--") + 1])
