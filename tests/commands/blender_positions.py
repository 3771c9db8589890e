"""Load files into Blender; write names, frame rate and joint positions of its armatures as JSON.

Usage: python blender_positions.py FPS FILE... (by an interpreter that has bpy)

All files are loaded into one empty scene of FPS frames a second, as glTF has seconds and no frames.
Positions are those of the heads of all bones in every frame, in metres, z up.
"""

import json
import sys

import bpy


def load(file):
    """Load a BVH or glTF file with Blender's own settings."""
    if file.endswith(".bvh"):
        bpy.ops.import_anim.bvh(filepath=file, update_scene_fps=True)
    else:
        bpy.ops.import_scene.gltf(filepath=file)


def positions(armature, frames):
    """Return the positions of all bones in the frames, by name."""
    found = {bone.name: [] for bone in armature.pose.bones}
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        for bone in armature.pose.bones:
            found[bone.name].append(list(armature.matrix_world @ bone.head))
    return found


def main(fps, *files):
    """Load all files and write what the scene holds."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = int(fps)
    for file in files:
        load(file)
    starts, ends = zip(*(action.frame_range for action in bpy.data.actions), strict=True)
    frames = range(round(min(starts)), round(max(ends)) + 1)
    armatures = [thing for thing in scene.objects if thing.type == "ARMATURE"]
    facts = {
        "fps": scene.render.fps / scene.render.fps_base,
        "armatures": {armature.name: positions(armature, frames) for armature in armatures},
    }
    sys.stdout.write("\n" + json.dumps(facts) + "\n")


main(*sys.argv[1:])
