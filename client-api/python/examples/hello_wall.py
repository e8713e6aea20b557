"""Shows a scene on one channel or thirty: hello_wall.py SCENE.glb [HOST:PORT [FOLDER]]."""

import sys

import polyptych


def main(path: str, address: str = "127.0.0.1:7880", folder: str = ".") -> int:
    with polyptych.Client.connect(address, name="hello_wall") as wall:
        scene = wall.open_scene(path)
        if scene.bounds is not None:
            wall.set_camera(polyptych.fit_bounds(wall.wall(), scene.bounds, 0.6))
        drawn = wall.render_frame()
        shown, count = len(list(drawn.shown_channels())), len(drawn.channels)
        print(f"{scene.name}: frame {drawn.frame} on {shown} of {count} channels")
        for channel in drawn.missing_channels():
            print(f"channel {channel.name} is {channel.state.value}: {channel.reason}")
        for image in wall.capture().screens:
            image.save(f"{folder}/{image.name}.png")
            print(f"{folder}/{image.name}.png has {image.width} x {image.height} pixels")
    return 0 if drawn.is_complete() else 3


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
