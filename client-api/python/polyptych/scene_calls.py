"""What a client does with the open scene: changes it, plays it, keeps it."""

from __future__ import annotations

from typing import Any, Dict, List, Optional, Union

from .requests import Requests
from .scene import ClipStatus, Edited, LayerInfo, SavedScene, SceneFileList, VariantList
from .transaction import Transaction


class SceneCalls(Requests):
    """Calls that change the open scene."""

    def close_scene(self) -> None:
        """Shows no scene."""
        self._do("CloseScene")

    def commit(self, transaction: Transaction) -> Edited:
        """Changes the open scene by all of these edits, on all displays from one frame on.

        Returns once that frame was swapped, which a paused wall draws for it. The manager bakes
        files that it brings first; this waits for them as long as the manager answers.

        :raises Failed: an edit cannot be, which the reason names; then nothing is changed.
        """
        return self._ask({"Edit": transaction}, "Edited", Edited)

    def layers(self) -> List[LayerInfo]:
        """Returns the layers of the open scene, by name."""
        return self._ask("ListLayers", "Layers", List[LayerInfo])

    def set_variant(self, variant: Union[str, int, None]) -> Edited:
        """Shows a variant of the scene by its name or its number; ``None`` for none.

        :raises Failed: there is none of this name; the reason has all there are.
        """
        transaction = Transaction()
        transaction.set_variant(variant)
        return self.commit(transaction)

    def variants(self) -> VariantList:
        """Returns the variants of the open scene."""
        return self._ask("ListVariants", "Variants", VariantList)

    def play_clip(
        self,
        clip: Union[str, int, None] = None,
        speed: Optional[float] = None,
        weight: Optional[float] = None,
        is_looping: Optional[bool] = None,
    ) -> None:
        """Lets an animation go on, by its name or its number; all that move something if ``None``.

        :param speed: seconds of it in a second of scene time; negative for backwards.
        :param weight: its part beside others; a clip that is named is played alone unless given.
        """
        play = {"speed": speed, "weight": weight, "is_looping": is_looping}
        self.change_clips(clip, {"Play": play})

    def pause_clip(self, clip: Union[str, int, None] = None) -> None:
        """Holds an animation where it is, or all."""
        self.change_clips(clip, "Pause")

    def seek_clip(self, time_s: float, clip: Union[str, int, None] = None) -> None:
        """Puts an animation, or all, to a time in seconds since its beginning."""
        self.change_clips(clip, {"Seek": time_s})

    def change_clips(self, clip: Union[str, int, None], action: Union[str, Dict[str, Any]]) -> None:
        """Changes how an animation is played; ``action`` is in the form of the wire.

        :raises Failed: there is no such animation; the reason has all there are.
        """
        name = None if clip is None else str(clip)
        self._do({"ChangeClips": {"clip": name, "action": action}})

    def clips(self) -> List[ClipStatus]:
        """Returns the animations of the open scene, in the order of their numbers."""
        return self._ask("ListClips", "Clips", List[ClipStatus])

    def scene_files(self) -> SceneFileList:
        """Returns the scene files in the manager's scene folders, by path."""
        return self._ask("ListSceneFiles", "SceneFiles", SceneFileList)

    def save_scene(self, name: str) -> None:
        """Keeps the open scene with all that was changed of it; ``saved:NAME`` opens it."""
        self._do({"SaveScene": {"name": name}})

    def saved_scenes(self) -> List[SavedScene]:
        """Returns the scenes that were saved, by name."""
        return self._ask("ListSavedScenes", "SavedScenes", List[SavedScene])

    def remove_saved_scene(self, name: str) -> None:
        """Forgets a scene that was saved."""
        self._do({"RemoveSavedScene": {"name": name}})
