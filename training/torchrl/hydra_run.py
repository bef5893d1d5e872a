"""BenchMARL's command for the scenarios, with its algorithms, models and settings by Hydra.

    python -m training.torchrl.hydra_run task=lissajous/intruders algorithm=mappo "experiment.loggers=[csv]"
    python -m training.torchrl.hydra_run task=lissajous/rough algorithm=ippo +task.targets.count=5 seed=1

Fields of the scenario are `+task.PART.FIELD`; with `task.state=true` central critics read the true state. Without
`experiment.loggers`, BenchMARL logs to Weights & Biases, too, which requires `wandb`.
"""

from lissajous_env.plugins import requiring

with requiring("training.torchrl.hydra_run", "marl"):
    from benchmarl.environments import task_config_registry
    from benchmarl.run import hydra_experiment
    from hydra.core.config_store import ConfigStore

    from training.torchrl.benchmarl import LissajousTask

for task in LissajousTask:
    name = task.name.lower().replace("_", "-")
    task_config_registry[f"lissajous/{name}"] = task
    ConfigStore.instance().store(group="task/lissajous", name=name, node={"state": False})

if __name__ == "__main__":
    hydra_experiment()
