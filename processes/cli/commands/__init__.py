"""The commands of `edc-swarm`, one file each."""
