"""What a viewer is shown: the swarm as foxglove scenes, built of swarm messages and nothing else.

`Scenery` follows a mission and gives the bytes that the visualiser publishes; `channel_of` says how
a recorder or a live view describes them; `layout` is the viewer's layout. The simulator, the
visualiser process and `edc-swarm visualise` feed the very same class.
"""

from edc_swarm.viz.channels import ROOT, TOPICS, channel_of, topic_of
from edc_swarm.viz.layout import LAYOUT_ATTACHMENT, layout
from edc_swarm.viz.scenery import Scenery, Shown

__all__ = ["LAYOUT_ATTACHMENT", "ROOT", "TOPICS", "Scenery", "Shown", "channel_of", "layout", "topic_of"]
