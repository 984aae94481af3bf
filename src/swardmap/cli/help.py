"""What --help says beyond each verb's own words: one short line a verb, and the default of every option."""

from typing import Any

from swardmap.config import Config

SHORT = {
    "map": "Turn a recording or a live camera into an obstacle map.",
    "record": "Record a camera or any other source to one MCAP file.",
    "view": "Watch a recording or a camera being mapped.",
    "demo": "Map a drive that comes with the package, and measure the map.",
    "evaluate": "Compare maps with their truth; measure the margin.",
    "compare": "Put evaluations side by side.",
    "convert": "Convert a map, a costmap, a cloud or annotations.",
    "synth": "Film procedural gardens with exact truth.",
    "teach": "Teach the network your lawn by one drive over it.",
    "train": "Train a network by a recipe; goes on where it was.",
    "export": "Export a network to ONNX with its metadata.",
    "ros": "Run the ROS 2 node.",
    "nav2": "Write parameter files for the node and for Nav2.",
    "config": "Print all settings with what each is for.",
    "doctor": "Say what works on this machine, and how fast it maps.",
}
"""Short enough for a terminal of 80 columns."""

SETTING_OF = {
    "segmenter": "segmenter.name",
    "resolution": "grid.resolution_m",
    "clouds": "output.clouds",
}
"""Options that stand for a setting, whose default is theirs."""

DEFAULT = {
    "kind": "recognised",
    "frames": "all",
    "duration": "no end",
    "set_": "none",
    "workers": "one a core",
    "jobs": "one a core",
    "pictures": "about 50",
    "protocol": "dense and paper",
    "illumination": "all",
    "save": "shown",
    "connect": "a new viewer",
    "jpeg": "raw",
    "masks": "the recording's own",
    "size": "the recipe's",
    "start": "the package's",
    "steps": "240, and half as many once more",
    "footprint": "a circle",
    "margin": "0.10 until one is measured",
    "provider": "cpu",
}
"""What happens where such an option is not given; the rest say "none"."""

OF_VERB = {
    ("evaluate", "resolution"): "0.05 and 0.1",
    ("nav2", "footprint"): "none",
    ("doctor", "segmenter"): "none",
}


def complete(group: Any) -> Any:
    """Give a click group its short lines, and each option without a default the words for it."""
    for verb, command in group.commands.items():
        command.short_help = SHORT.get(verb)
        for option in command.params:
            silent = option.default is None or option.default in ([], (), "")
            if option.param_type_name == "option" and silent and not option.required and not option.is_flag:
                option.show_default = told(verb, option.name)
    return group


def told(verb: str, name: str) -> str:
    """The default of an option in words."""
    if (verb, name) in OF_VERB:
        return OF_VERB[verb, name]
    if name in SETTING_OF:
        section, key = SETTING_OF[name].split(".")
        return str(getattr(getattr(Config(), section), key))
    return DEFAULT.get(name, "none")
