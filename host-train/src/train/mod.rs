//! The training loop: clouds in, checkpoints and metrics out.
//!
//! One update is Algorithm 1 of the paper, [`Trainer::update`]. It rolls out N trajectories of n steps from each of 32
//! problems with the stochastic policy, rewards them, computes returns and advantages, and goes once over the shuffled
//! buffer in mini-batches. Clouds come in an endless sequence of shuffled epochs: the first clouds of an epoch fill the
//! buffer that the last epoch left partly filled. No state but the number of updates lies between two updates.
//!
//! # Known details of PPO
//!
//! The list is that of Huang et al., "The 37 implementation details of proximal policy optimization" (2022). Tests
//! are in the package `reagent-tests` unless a path is given.
//!
//! | detail | here | where | test |
//! |---|---|---|---|
//! | 1 vectorised environments | yes: 128 trajectories side by side; all end after n steps, so none is reset in a buffer | `roll_out.rs` | `rewards_belong_to_the_steps_that_earned_them` |
//! | 2 orthogonal weights, constant biases | no: PyTorch's uniform, as in the authors' code | [`Parameters::random`](crate::learn::nn::Parameters::random) | `forward_pass_of_the_trainer_and_of_the_robot` (layout) |
//! | 3 Adam's epsilon of 1e-5 | no: 1e-8, with AMSGrad, as in the authors' code | [`crate::learn::optim`] | `amsgrad_and_its_schedule_agree` |
//! | 4 annealed learning rate | halved every 10 epochs; linear and cosine by `--anneal` | [`LearningRate`] | `rates_fall_as_described` |
//! | 5 generalised advantage estimation | yes; but returns are plain discounted sums, not advantage + value, as in the authors' code | [`Buffer::compute_returns`](crate::learn::buffer::Buffer::compute_returns) | `returns_and_advantages_equal_the_reference` |
//! | 6 mini-batches of the whole shuffled buffer | yes, one pass instead of several | [`Trainer::update`] | `a_resumed_run_has_the_bits_of_an_uninterrupted_one` |
//! | 7 normalised advantages | `--normalise-advantages` | [`crate::learn::loss`] | `gradients_equal_finite_differences_on_a_small_shape` |
//! | 8 clipped surrogate | yes, a ratio for each axis | [`crate::learn::loss`] | `all_parts_of_the_loss_equal_the_reference` |
//! | 9 clipped value loss | `--clip-values` | [`crate::learn::loss`] | `gradients_equal_finite_differences_on_a_small_shape` |
//! | 10 one loss with entropy bonus | yes: 0.3 value, 0.001 entropy, and imitation | [`crate::learn::loss`] | `gradients_at_alpha_0_and_2_equal_the_reference` |
//! | 11 global gradient clipping | `--clip-gradient` | [`Trainer`] | `long_gradients_are_clipped_and_averages_follow` |
//! | 12 debug variables | yes: all of them, and agreement with the expert | [`UpdateStats`] | `all_parts_of_the_loss_equal_the_reference` (KL, clip fraction) |
//! | 13 shared or separate networks | shared embedding; the value head reads both policy heads, and its gradient flows into them | [`crate::learn::heads`] | `gradients_at_alpha_0_and_2_equal_the_reference` |
//! | 14-22 Atari wrappers and networks | no: there are no images, lives or frames | | |
//! | 23, 24, 27 Gaussian actions, their deviation, clipping of actions | no: actions are discrete and all valid | | |
//! | 25, 37 independent components of actions | yes: six categorical distributions; ratios are clipped each by itself, not as a product | [`crate::learn::loss`] | `all_parts_of_the_loss_equal_the_reference` |
//! | 26 separate networks for continuous control | no, see 13 | | |
//! | 28-31 normalised or clipped observations and rewards | no: clouds are in normalised units, rewards are .5, -.1, -.6 | [`crate::learn::reward`] | `rewards_follow_the_chamfer_distance` |
//! | 32-36 LSTM | no: a state is one observation | | |
//! | time limit of the episode is no terminal state | `--bootstrap` adds the value of the last state; by default it counts as 0, as in the authors' code | [`Buffer::compute_returns`](crate::learn::buffer::Buffer::compute_returns) | `returns_and_advantages_equal_the_reference` |
//! | annealed clipping range | no | | |
//! | parallel gradients | yes, summed in a fixed order | [`crate::learn::agent`] | `results_do_not_depend_on_the_number_of_threads` |
//! | early stopping by KL | no: with one pass it stays near 0.01; it is logged | [`UpdateStats`] | |
//! | masked invalid actions | no: all are valid | | |
//! | returns on the samples they belong to | yes; the authors' code gives 318 of 320 samples those of others | [`Buffer`](crate::learn::buffer::Buffer) | `the_authors_order_gives_samples_the_returns_of_others` |
//! | exact resumption | yes, also after a kill | [`record`], [`crate::policy::checkpoint`] | `a_killed_run_goes_on_as_if_nothing_had_happened`; `host-train/tests/training.rs` |

mod begin;
mod bench;
mod config;
mod data;
mod error;
mod fine_tune;
mod learning_rate;
mod method;
mod progress;
pub mod record;
mod roll_out;
mod run;
mod state;
mod stats;
mod trainer;
mod validate;

pub use bench::{Speed, bench};
pub use config::{Categories, DataSource, Network, Stage, TrainConfig};
pub use error::TrainError;
pub use fine_tune::fine_tune;
pub use learning_rate::{Anneal, LearningRate};
pub use method::{Follow, Method, RollOut};
pub use run::run;
pub use stats::UpdateStats;
pub use trainer::{Diverged, Spent, Trainer};
