"""Every error and warning of `rbd`, in one tree; and `Reason`, which each error has: why there is no answer, with a code.

::

    RbdError
      InputError (also a ValueError)    an argument is wrong; nothing was computed
        UnknownName                     a name that is not in the model; nearest names in the message
          UnknownRobot, FrameNotFound, JointNotFound
        DuplicateName                   two constraints, or two rows, under one name
        BadEvent                        an event of a simulation that is no number, is zero throughout, or chatters
      ModelError                        a robot file is missing, broken or not a robot
      ContactMoves                      a contact that can break or slip already moves
      NotAtRest                         statics of a moving robot
      Unsupported                       this solver cannot take this problem; the message gives the reason
      NotDifferentiable                 an answer at a change of contact mode has no derivatives
      SingularInertia                   M(q) is not positive definite
      NoSolution                        no answer within tolerance; carries problem and result
        CannotMove                      no motor torques and contact forces move the robot as wanted; names the limits
          CannotHold                    none hold it still
          CannotPlan                    no plan from keyframe to keyframe; with the instants and the nearest plan
        CannotAssemble                  loops that do not close, or not from here; names the rows and the distance
        CannotReach                     no pose satisfies the targets, or none was found; with the nearest pose
        SingularPose                    here the known motions do not decide the others
        NoSteadyState                   no equilibrium, or no steady motion, was found; with the nearest state
        SimulationStopped               a step of a simulation has no solution, or a function of the user raised an error;
                                        carries what was computed till then
      StudyStopped                      a study ended before all samples were computed; carries what is done
      PictureError                      a page or a screenshot could not be made
      WrongPinocchio (an ImportError)   another package, or ROS's, is found in place of pip's Pinocchio
      ContractBroken                    in rbd.testing: a constraint or a solver violates its contract
        ConstraintWrong, SolverWrong, TaskWrong

    RbdWarning (a UserWarning)
      EffortLimitWarning                a torque given is beyond a motor's limit
      ForceElementWarning               a spring has a negative stiffness
      SpeedLimitWarning                 a joint is faster than its motor can turn
      JointLimitWarning                 a joint of a state is beyond its limits
      InaccurateWarning                 the answer is worse than 1e-9, though better than 1e-7; or a simulation recorded a
                                        residual above 1e-7, or steps that make energy
      LoopNotClosedWarning              a loop is not closed at this state, and is solved unchanged
      ModelWarning                      a robot file that loads, but is not what it seems
      NonUniqueMotionWarning            more than one motion satisfies the contact law; the answer is one of them
      NotSteadyWarning                  a state is linearised that is neither an equilibrium nor a steady motion
      OpeningContactWarning             a contact separates, and its force is zero
      PoorExcitationWarning             measured motions tell less of some parameters than the model does
      DistantContactWarning             a contact is not on its plane
      MovingConstraintWarning           a bilateral constraint has a velocity
      RelaxedLimitsWarning              a step of control violates contacts or joint limits by the least
      StudyWarning                      a study ended early, or goes on with what another version computed
"""

from rbd.errors.inputs import (
    BadEvent,
    ContactMoves,
    DuplicateName,
    FrameNotFound,
    JointNotFound,
    ModelError,
    NotAtRest,
    NotDifferentiable,
    NotEnclosed,
    PictureError,
    SingularInertia,
    UnknownName,
    UnknownRobot,
    Unsupported,
    WrongPinocchio,
    nearest,
)
from rbd.errors.no_solution import (
    CannotAssemble,
    CannotHold,
    CannotMove,
    CannotPlan,
    CannotReach,
    NoSolution,
    NoSteadyState,
    SimulationStopped,
    SingularPose,
    StudyStopped,
)
from rbd.errors.reasons import InputError, RbdError, Reason
from rbd.errors.warned import (
    DistantContactWarning,
    EffortLimitWarning,
    ForceElementWarning,
    InaccurateWarning,
    JointLimitWarning,
    LoopNotClosedWarning,
    ModelWarning,
    MovingConstraintWarning,
    NonUniqueMotionWarning,
    NotSteadyWarning,
    OpeningContactWarning,
    PoorExcitationWarning,
    RbdWarning,
    RelaxedLimitsWarning,
    SpeedLimitWarning,
    StudyWarning,
)

__all__ = [
    "BadEvent",
    "CannotAssemble",
    "CannotHold",
    "CannotPlan",
    "CannotMove",
    "CannotReach",
    "ContactMoves",
    "DistantContactWarning",
    "DuplicateName",
    "EffortLimitWarning",
    "ForceElementWarning",
    "FrameNotFound",
    "InaccurateWarning",
    "InputError",
    "JointLimitWarning",
    "JointNotFound",
    "LoopNotClosedWarning",
    "ModelError",
    "ModelWarning",
    "NoSolution",
    "NoSteadyState",
    "MovingConstraintWarning",
    "NonUniqueMotionWarning",
    "NotAtRest",
    "NotDifferentiable",
    "NotEnclosed",
    "NotSteadyWarning",
    "OpeningContactWarning",
    "PictureError",
    "PoorExcitationWarning",
    "RbdError",
    "RbdWarning",
    "Reason",
    "RelaxedLimitsWarning",
    "SimulationStopped",
    "SingularInertia",
    "SingularPose",
    "SpeedLimitWarning",
    "StudyStopped",
    "StudyWarning",
    "StudyWarning",
    "UnknownName",
    "UnknownRobot",
    "Unsupported",
    "WrongPinocchio",
    "nearest",
]

for _name in __all__:
    globals()[_name].__module__ = __name__  # a traceback and a filter of warnings say rbd.errors, where users import it
