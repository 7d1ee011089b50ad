"""rivals.py: the scenes of `make rivals` for OpenVDB, VTK and Blender's Cycles, from what `rivals prepare` wrote.
python3 tests/measure/rivals.py FOLDER writes FOLDER/density.vdb, for vdb_render and for Cycles.
python3 tests/measure/rivals.py FOLDER STEP SIZE FILE renders FOLDER's scan by VTK's ray caster into a PFM: samples every
STEP voxels, SIZE pixels along both sides.
blender -b --factory-startup -P tests/measure/rivals.py -- FOLDER SAMPLES STEP SIZE FILE renders FOLDER's scene by Cycles into an
OpenEXR file: SAMPLES per pixel at most, rays in steps of STEP voxels, SIZE pixels along both sides."""

import math
import sys


def read_scene(folder):
    scene = {}
    for line in open(folder + "/scene.txt"):
        name, *numbers = line.split()
        scene[name] = [float(n) for n in numbers] if len(numbers) > 1 else float(numbers[0])
    return scene


def write_vdb(folder):
    import numpy
    import pyopenvdb

    scene = read_scene(folder)
    size = [int(n) for n in scene["Size"]]
    values = numpy.fromfile(folder + "/density.raw", numpy.float32).reshape(size[::-1]).transpose()
    grid = pyopenvdb.FloatGrid()
    grid.copyFromArray(numpy.ascontiguousarray(values), tolerance=0)
    grid.name = "density"
    grid.gridClass = pyopenvdb.GridClass.FOG_VOLUME
    grid.transform = pyopenvdb.createLinearTransform(voxelSize=scene["Edge"])
    grid.transform.translate(scene["First"])
    pyopenvdb.write(folder + "/density.vdb", [grid])


def add_camera(bpy, scene):
    from mathutils import Matrix

    data = bpy.data.cameras.new("eye")
    data.sensor_fit, data.angle = "VERTICAL", 2 * math.atan(scene["Half"])
    data.clip_end = 1000
    eye = bpy.data.objects.new("eye", data)
    rows = [[scene["Right"][k], scene["Up"][k], -scene["Ahead"][k], scene["Eye"][k]] for k in range(3)]
    eye.matrix_world = Matrix(rows + [[0, 0, 0, 1]])
    bpy.context.collection.objects.link(eye)
    bpy.context.scene.camera = eye


def add_sun(bpy, scene):
    from mathutils import Vector

    data = bpy.data.lights.new("sun", "SUN")
    data.energy, data.angle = scene["Irradiance"], scene["SunAngle"]
    sun = bpy.data.objects.new("sun", data)
    sun.rotation_mode = "QUATERNION"
    sun.rotation_quaternion = Vector(scene["Toward"]).to_track_quat("Z", "Y")
    bpy.context.collection.objects.link(sun)


def add_polygons(bpy, folder):
    """The ground, two triangles, and the rest: an object for each reflectance."""
    objects = {}
    for line in open(folder + "/triangles.txt"):
        numbers = [float(n) for n in line.split()]
        objects.setdefault(numbers[9], []).append([numbers[0:3], numbers[3:6], numbers[6:9]])
    for reflectance, triangles in objects.items():
        corners = [corner for triangle in triangles for corner in triangle]
        mesh = bpy.data.meshes.new("land")
        mesh.from_pydata(corners, [], [(3 * i, 3 * i + 1, 3 * i + 2) for i in range(len(triangles))])
        material = bpy.data.materials.new("land")
        material.use_nodes = True
        nodes = material.node_tree.nodes
        nodes.clear()
        diffuse, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
        diffuse.inputs["Color"].default_value = (reflectance, reflectance, reflectance, 1)
        material.node_tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
        mesh.materials.append(material)
        bpy.context.collection.objects.link(bpy.data.objects.new("land", mesh))


def gas_material(bpy, scene, step):
    """Scattering and absorption, each its share of the extinction, in proportion to the voxels."""
    material = bpy.data.materials.new("gas")
    material.use_nodes = True
    material.cycles.volume_step_rate = step
    material.cycles.volume_sampling = "DISTANCE"
    tree = material.node_tree
    tree.nodes.clear()
    output, both = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeAddShader")
    voxels = tree.nodes.new("ShaderNodeAttribute")
    voxels.attribute_name = "density"
    albedo = scene["Albedo"]
    shares = {"ShaderNodeVolumeScatter": albedo, "ShaderNodeVolumeAbsorption": 1 - albedo}
    for place, (kind, share) in enumerate(shares.items()):
        shader, times = tree.nodes.new(kind), tree.nodes.new("ShaderNodeMath")
        times.operation = "MULTIPLY"
        times.inputs[1].default_value = scene["Extinction"] * share
        # Absorption takes 1 - color times the density, scattering color times the density.
        shader.inputs["Color"].default_value = (1, 1, 1, 1) if place == 0 else (0, 0, 0, 1)
        if place == 0:
            shader.inputs["Anisotropy"].default_value = scene["Asymmetry"]
        tree.links.new(voxels.outputs["Fac"], times.inputs[0])
        tree.links.new(times.outputs[0], shader.inputs["Density"])
        tree.links.new(shader.outputs[0], both.inputs[place])
    tree.links.new(both.outputs[0], output.inputs["Volume"])
    return material


def add_gas(bpy, folder, scene, step):
    """Cycles has the middle of a voxel half a voxel beyond where OpenVDB has it: the volume is moved back."""
    bpy.ops.object.volume_import(filepath=folder + "/density.vdb", align="WORLD", location=[-0.5 * scene["Edge"]] * 3)
    volume = bpy.context.object
    volume.rotation_euler = (0, 0, 0)
    volume.data.render.precision = "FULL"
    volume.data.render.clipping = 0
    volume.data.materials.append(gas_material(bpy, scene, step))


def set_up(bpy, scene, samples, size, path):
    """Exactly what the others compute: no filter across pixels, nothing clamped, guessed or left out."""
    render, cycles = bpy.context.scene.render, bpy.context.scene.cycles
    all_orders = scene["Asymmetry"] != 0
    render.engine, render.threads_mode, render.threads = "CYCLES", "FIXED", 2
    render.resolution_x = render.resolution_y = size
    render.resolution_percentage = 100
    render.filepath = path
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGB"
    render.image_settings.color_depth, render.image_settings.exr_codec = "32", "NONE"
    cycles.device, cycles.samples = "CPU", samples
    cycles.use_adaptive_sampling, cycles.adaptive_threshold, cycles.adaptive_min_samples = True, 0.003, 8
    cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 0.01
    cycles.max_bounces, cycles.volume_bounces = (1024, 1024) if all_orders else (0, 0)
    cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 0
    cycles.transparent_max_bounces = 1024
    cycles.volume_max_steps = 65536
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0
    world = bpy.data.worlds.new("black")
    world.use_nodes = False
    world.color = (0, 0, 0)
    bpy.context.scene.world = world


def render_cycles(folder, samples, step, size, path):
    import bpy

    scene = read_scene(folder)
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    add_camera(bpy, scene)
    add_sun(bpy, scene)
    add_polygons(bpy, folder)
    add_gas(bpy, folder, scene, step)
    set_up(bpy, scene, samples, size, path)
    bpy.ops.render.render(write_still=True)


def look_of(scene, length):
    """Colors, and the opacity of a length, over the 15 bits that VTK computes in."""
    import numpy
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

    colors, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    values = 32767 / scene["Most"] * numpy.array(scene["Values"])
    for point in zip(values, scene["Reds"], scene["Greens"], scene["Blues"]):
        colors.AddRGBPoint(*point)
    depths = length * numpy.interp(numpy.arange(32768), values, scene["Extinctions"])
    opacity.BuildFunctionFromTable(0, 32767, 32768, -numpy.expm1(-depths))
    return colors, opacity


def scan_of(folder, scene):
    import numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.util.numpy_support import numpy_to_vtk

    stored = numpy.fromfile(folder + "/density.df3", ">u2", offset=6) >> 1
    scan = vtkImageData()
    scan.SetDimensions([int(n) for n in scene["Size"]])
    scan.SetSpacing([scene["Edge"]] * 3)
    scan.SetOrigin(scene["First"])
    scan.GetPointData().SetScalars(numpy_to_vtk(stored.astype(numpy.uint16)))
    return scan


def write_cast(image, size, path):
    """The mapper's picture covers a part of the window; its bottom row is the first, as in a PFM."""
    import ctypes
    import numpy

    (width, height), (x, y), (across, up) = image.GetImageMemorySize(), image.GetImageOrigin(), image.GetImageInUseSize()
    stored = (ctypes.c_uint16 * (4 * width * height)).from_address(int(image.GetImage().split("_")[1], 16))
    pixels = numpy.zeros((size, size, 3), "<f4")
    pixels[y:y + up, x:x + across] = numpy.array(stored).reshape(height, width, 4)[:up, :across, :3] / 32767
    with open(path, "wb") as file:
        file.write(b"PF\n%d %d\n-1\n" % (size, size) + pixels.tobytes())


def render_vtk(folder, step, size, path):
    """What the mapper's Render() does, except showing the picture, which would need a display."""
    import vtkmodules.vtkRenderingVolumeOpenGL2
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow, vtkVolume
    from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper

    scene = read_scene(folder)
    length = step * scene["Edge"]
    colors, opacity = look_of(scene, length)
    volume, mapper, window, renderer = vtkVolume(), vtkFixedPointVolumeRayCastMapper(), vtkRenderWindow(), vtkRenderer()
    look = volume.GetProperty()
    look.SetInterpolationTypeToLinear()
    look.SetColor(colors)
    look.SetScalarOpacity(opacity)
    look.SetScalarOpacityUnitDistance(length)
    mapper.SetInputData(scan_of(folder, scene))
    mapper.SetAutoAdjustSampleDistances(0)
    mapper.SetSampleDistance(length)
    mapper.SetNumberOfThreads(2)
    volume.SetMapper(mapper)
    window.SetSize(size, size)
    window.AddRenderer(renderer)
    eye = renderer.GetActiveCamera()
    eye.SetPosition(scene["Eye"])
    eye.SetFocalPoint([a + b for a, b in zip(scene["Eye"], scene["Ahead"])])
    eye.SetViewUp(scene["Up"])
    eye.SetViewAngle(2 * math.degrees(math.atan(scene["Half"])))
    eye.SetClippingRange(1, 100)
    mapper.PerImageInitialization(renderer, volume, 0, [0] * 3, [0] * 3, [0] * 6)
    mapper.PerVolumeInitialization(renderer, volume)
    mapper.PerSubVolumeInitialization(renderer, volume, 0)
    mapper.RenderSubVolume()
    write_cast(mapper.GetRayCastImage(), size, path)


if "--" in sys.argv:
    arguments = sys.argv[sys.argv.index("--") + 1:]
    render_cycles(arguments[0], int(arguments[1]), float(arguments[2]), int(arguments[3]), arguments[4])
elif len(sys.argv) > 2:
    render_vtk(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
else:
    write_vdb(sys.argv[1])
