//! Links that wrap another link and change or observe its traffic.

use std::time::Duration;

use super::{Dir, KnownNetwork, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::sk::Frame;

/// A link around another link. An implementation defines only the calls that it changes; all others go to
/// [`Layer::inner`]. Every layer is a [`Link`].
///
/// This trait also passes [`Link::vanish`] on to the inner link. With the default of [`Link::vanish`] a layer would
/// close the inner link instead.
pub trait Layer: Send + Sync {
    /// The wrapped link, to which all calls go that the layer does not change.
    fn inner(&self) -> &dyn Link;

    /// [`Link::info`] of this layer; by default that of the inner link.
    fn info(&self) -> LinkInfo {
        self.inner().info()
    }

    /// [`Link::network`] of this layer; by default that of the inner link.
    fn network(&self) -> Option<KnownNetwork> {
        self.inner().network()
    }

    /// [`Link::write`] of this layer; by default that of the inner link.
    ///
    /// # Errors
    /// Those of [`Link::write`].
    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.inner().write(frame, wait)
    }

    /// [`Link::read`] of this layer; by default that of the inner link.
    ///
    /// # Errors
    /// Those of [`Link::read`].
    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.inner().read(out, wait)
    }

    /// [`Link::pass`] of this layer; by default that of the inner link.
    ///
    /// # Errors
    /// Those of [`Link::pass`].
    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        self.inner().pass(time)
    }

    /// [`Link::cancel`] of this layer; by default that of the inner link.
    fn cancel(&self, dir: Dir) {
        self.inner().cancel(dir);
    }

    /// [`Link::close`] of this layer; by default that of the inner link.
    fn close(&self) {
        self.inner().close();
    }

    /// [`Link::vanish`] of this layer; by default that of the inner link.
    fn vanish(&self) {
        self.inner().vanish();
    }

    /// [`Link::check`] of this layer; by default that of the inner link.
    ///
    /// # Errors
    /// Those of [`Link::check`].
    fn check(&self) -> Result<(), LinkError> {
        self.inner().check()
    }

    /// [`Link::stats`] of this layer; by default those of the inner link.
    fn stats(&self) -> LinkStats {
        self.inner().stats()
    }

    /// [`Link::recorded_before`] of this layer; by default that of the inner link.
    fn recorded_before(&self) -> Duration {
        self.inner().recorded_before()
    }
}

impl<T: Layer> Link for T {
    fn info(&self) -> LinkInfo {
        Layer::info(self)
    }

    fn network(&self) -> Option<KnownNetwork> {
        Layer::network(self)
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        Layer::write(self, frame, wait)
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        Layer::read(self, out, wait)
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        Layer::pass(self, time)
    }

    fn cancel(&self, dir: Dir) {
        Layer::cancel(self, dir);
    }

    fn close(&self) {
        Layer::close(self);
    }

    fn vanish(&self) {
        Layer::vanish(self);
    }

    fn check(&self) -> Result<(), LinkError> {
        Layer::check(self)
    }

    fn stats(&self) -> LinkStats {
        Layer::stats(self)
    }

    fn recorded_before(&self) -> Duration {
        Layer::recorded_before(self)
    }
}
